/// @file field_sample.h  Contacts to measure a stored field with (private).
#ifndef PALPATE_SRC_FIELD_SAMPLE_H
#define PALPATE_SRC_FIELD_SAMPLE_H

#include "haptic/model/model.h"

enum { PALPATE_SAMPLE_NODES = 45, PALPATE_SAMPLE_COUNT = 48 };

/// One contact: the nodes nearest to one of the touchable nodes under a bell of pressure.
typedef struct pal_sample_contact {
    int32_t count; ///< dofs, three per node
    int32_t dof[3 * PALPATE_SAMPLE_NODES];
    double force[3 * PALPATE_SAMPLE_NODES]; ///< [N]
} pal_sample_contact;

/// Contacts and their exact fields.
typedef struct pal_field_sample {
    int32_t count;
    pal_sample_contact *contact; ///< (count)
    double *field;               ///< (count x 3 row_count) [m]
} pal_field_sample;

/// `count` contacts of 1, 4, 15 and 45 nodes in turn at random places of the model (the same for
/// the same seed), pressure along the inward normals, friction of 0.3 in every second round; their
/// fields in double precision from the rows as the model stores them now.
/// @return PALPATE_OK; _MEMORY
PALPATE_API pal_status pal_field_sample_make(const pal_model *model, uint64_t seed, int32_t count,
                                             pal_field_sample *out, pal_error *error);
PALPATE_API void pal_field_sample_clear(pal_field_sample *sample);

/// Worst over the contacts of max |du| / max |u|, maxima over the stored nodes, of what the engine
/// would compute from the model's rows (pal_field_compute) against the sample's exact fields.
/// @param[out] cost  mean of pal_field_predict over the contacts of most nodes [ns]; may be NULL
/// @return PALPATE_OK; _MEMORY
PALPATE_API pal_status pal_field_sample_error(const pal_field_sample *sample,
                                              const pal_model *model, double *worst, double *cost,
                                              pal_error *error);

#endif
