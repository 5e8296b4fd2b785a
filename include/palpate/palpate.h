/// @file palpate.h  Everything of the online library, libpalpate. The offline library's headers
/// (scene.h, precompute.h) are included apart, because they link GPL parts.
#ifndef PALPATE_PALPATE_H
#define PALPATE_PALPATE_H

#include <palpate/engine.h>
#include <palpate/model.h>
#include <palpate/session.h>
#include <palpate/status.h>
#include <palpate/tool.h>

#endif
