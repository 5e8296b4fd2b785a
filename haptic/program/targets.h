/// @file targets.h  Where a command will write, looked at before the work begins (private).
///
/// A picture or a recording is written when a run ends; a folder that is not there, a name that
/// cannot be, a file that must not be overwritten are known at the start and are refused there. A
/// disk that fills up meanwhile is not: that is reported at the end, beside what was measured.
#ifndef PALPATE_PROGRAM_TARGETS_H
#define PALPATE_PROGRAM_TARGETS_H

#include <palpate/status.h>

/// Can `path` be written, as far as can be told without writing?
/// @param option  for the message: "--snapshot"
/// @param path  NULL: nothing asked for, PALPATE_OK
/// @param kinds  endings it may have, ".h5 .hdf5"; NULL: any
/// @param source  what the command reads and must not overwrite; NULL: nothing
/// @return PALPATE_OK; _ARGUMENT for an ending or the source itself, _IO for the place
pal_status target_check(const char *option, const char *path, const char *kinds, const char *source,
                        pal_error *error);

#endif
