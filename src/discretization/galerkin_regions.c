/// @file galerkin_regions.c  Regions as sums of parts of tetrahedra, and their energy.
///
/// The mean gradient of a linear function over a union of parts of tetrahedra is the
/// volume-weighted mean of the tetrahedra's gradients: G_r = sum_T V_rT g_T / V_r with V_rT = V_T /
/// 6 (pair), V_T / 4 (node) or V_T. Each region is a run of sorted (key, tetrahedron) entries;
/// nothing depends on the order in which memory was handed out.
#include "src/discretization/galerkin_regions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

typedef pal_region_part part;

typedef struct tet_shape {
    double gradient[4][3];
    double volume;
    double condition;
} tet_shape;

static int part_compare(const void *pa, const void *pb) {
    const part *a = pa, *b = pb;
    if (a->key != b->key) {
        return a->key < b->key ? -1 : 1;
    }
    return (a->tet > b->tet) - (a->tet < b->tet);
}

static int index_compare(const void *pa, const void *pb) {
    const int32_t *a = pa, *b = pb;
    return (*a > *b) - (*a < *b);
}

/// Gradients of the four linear trial functions, volume, and ||J|| ||J^-1|| / 3 of the edge matrix
/// (1: three orthogonal equal edges), which is the conditioning of the 4-node linear MLS.
static void tet_shape_of(const pal_cloud *cloud, int32_t t, tet_shape *out) {
    const int32_t *n = cloud->tet + 4 * (size_t)t;
    const double *origin = cloud->position + 3 * (size_t)n[0];
    double e[3][3], norm = 0.0, inverse_norm = 0.0;
    for (int k = 0; k < 3; k++) {
        const double *x = cloud->position + 3 * (size_t)n[k + 1];
        for (int c = 0; c < 3; c++) {
            e[k][c] = x[c] - origin[c];
            norm += e[k][c] * e[k][c];
        }
    }
    double det = 0.0;
    for (int k = 0; k < 3; k++) {
        // cppcheck-suppress uninitvar // v3_cross() writes it
        v3_cross(e[(k + 1) % 3], e[(k + 2) % 3], out->gradient[k + 1]);
    }
    for (int c = 0; c < 3; c++) {
        det += e[0][c] * out->gradient[1][c];
    }
    for (int c = 0; c < 3; c++) {
        out->gradient[0][c] = 0.0;
        for (int k = 1; k < 4; k++) {
            out->gradient[k][c] /= det;
            inverse_norm += out->gradient[k][c] * out->gradient[k][c];
            out->gradient[0][c] -= out->gradient[k][c];
        }
    }
    out->volume = det / 6.0;
    out->condition = sqrt(norm * inverse_norm) / 3.0;
}

static size_t parts_per_tet(pal_region_kind kind) {
    return kind == PALPATE_REGION_TET ? 1 : kind == PALPATE_REGION_PAIR ? 6 : 4;
}

static void list_parts(const pal_cloud *cloud, pal_region_kind kind, part *parts) {
    static const int pair[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
    size_t per = parts_per_tet(kind), at = 0;
    for (int32_t t = 0; t < cloud->tet_count; t++) {
        const int32_t *n = cloud->tet + 4 * (size_t)t;
        for (size_t k = 0; k < per; k++, at++) {
            parts[at].tet = t;
            if (kind == PALPATE_REGION_PAIR) {
                uint64_t a = (uint64_t)n[pair[k][0]], b = (uint64_t)n[pair[k][1]];
                parts[at].key = a < b ? a << 32 | b : b << 32 | a;
            } else {
                parts[at].key = kind == PALPATE_REGION_TET ? (uint64_t)t : (uint64_t)n[k];
            }
        }
    }
}

pal_region_part *pal_region_parts(const pal_cloud *cloud, pal_region_kind kind, size_t *count) {
    *count = parts_per_tet(kind) * (size_t)cloud->tet_count;
    part *parts = malloc(*count * sizeof *parts);
    if (parts != NULL) {
        list_parts(cloud, kind, parts);
        qsort(parts, *count, sizeof *parts, part_compare);
    }
    return parts;
}

/// Sorted unique nodes of the tetrahedra of parts[from, to). @return their count
static int32_t gather_nodes(const pal_cloud *cloud, const part *parts, size_t from, size_t to,
                            int32_t *seen, int32_t *node) {
    int32_t count = 0;
    for (size_t p = from; p < to; p++) {
        const int32_t *n = cloud->tet + 4 * (size_t)parts[p].tet;
        for (int k = 0; k < 4; k++) {
            if (seen[n[k]] < 0) {
                seen[n[k]] = 0;
                node[count++] = n[k];
            }
        }
    }
    qsort(node, (size_t)count, sizeof *node, index_compare);
    for (int32_t i = 0; i < count; i++) {
        seen[node[i]] = -1;
    }
    return count;
}

// A transposition by counting, so that each node's regions ascend.
void pal_regions_transpose(pal_regions *r, int32_t node_count) {
    memset(r->at_node, 0, ((size_t)node_count + 1) * sizeof *r->at_node);
    for (int64_t k = 0; k < r->start[r->count]; k++) {
        r->at_node[r->node[k] + 1]++;
    }
    for (int32_t i = 0; i < node_count; i++) {
        r->at_node[i + 1] += r->at_node[i];
    }
    for (int32_t f = 0; f < r->count; f++) {
        for (int64_t k = r->start[f]; k < r->start[f + 1]; k++) {
            int64_t at = r->at_node[r->node[k]]++;
            r->region[at] = f;
            r->local[at] = (int32_t)(k - r->start[f]);
        }
    }
    for (int32_t i = node_count; i > 0; i--) {
        r->at_node[i] = r->at_node[i - 1];
    }
    r->at_node[0] = 0;
}

/// Check the tetrahedra; note the worst one.
static pal_status check_tets(pal_regions *r, const pal_cloud *cloud, pal_error *error) {
    for (int32_t t = 0; t < cloud->tet_count; t++) {
        const int32_t *n = cloud->tet + 4 * (size_t)t;
        tet_shape shape;
        tet_shape_of(cloud, t, &shape);
        double centre[3];
        for (int c = 0; c < 3; c++) {
            centre[c] = 0.0;
            for (int k = 0; k < 4; k++) {
                centre[c] += 0.25 * cloud->position[3 * (size_t)n[k] + (size_t)c];
            }
        }
        if (!(shape.volume > 0.0) || !isfinite(shape.condition)) {
            return pal_fail(
                error, PALPATE_ERROR_CLOUD,
                "galerkin: tetrahedron %d at (%.4g, %.4g, %.4g) has volume %.3g: it must be "
                "positive; use another spacing",
                t, centre[0] * cloud->length, centre[1] * cloud->length, centre[2] * cloud->length,
                shape.volume);
        }
        if (shape.condition > r->worst_condition) {
            r->worst_condition = shape.condition;
            memcpy(r->worst_point, centre, sizeof centre);
        }
    }
    return PALPATE_OK;
}

/// Mean gradients and volume of region f, made of parts[from, to).
static void fill_region(pal_regions *r, int32_t f, const pal_cloud *cloud, const part *parts,
                        size_t from, size_t to, double share, int32_t *place) {
    int64_t base = r->start[f];
    for (int64_t k = base; k < r->start[f + 1]; k++) {
        place[r->node[k]] = (int32_t)(k - base);
    }
    double volume = 0.0;
    double *gradient = r->gradient + 3 * base;
    for (size_t p = from; p < to; p++) {
        const int32_t *n = cloud->tet + 4 * (size_t)parts[p].tet;
        tet_shape shape;
        tet_shape_of(cloud, parts[p].tet, &shape);
        double v = shape.volume * share;
        volume += v;
        for (int k = 0; k < 4; k++) {
            for (int c = 0; c < 3; c++) {
                gradient[3 * place[n[k]] + c] += v * shape.gradient[k][c];
            }
        }
    }
    r->volume[f] = volume;
    for (int64_t k = 0; k < 3 * (r->start[f + 1] - base); k++) {
        gradient[k] /= volume;
    }
    for (int64_t k = base; k < r->start[f + 1]; k++) {
        place[r->node[k]] = -1;
    }
}

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "galerkin: no memory for the cells' regions");
}

/// The regions proper, from their sorted parts; seen (node_count) is -1 everywhere.
static pal_status regions_fill(pal_regions *r, const pal_cloud *cloud, const part *parts,
                               size_t part_count, double share, int32_t *seen, int32_t *node) {
    size_t region_count = 0;
    for (size_t p = 0; p < part_count; p++) {
        region_count += p == 0 || parts[p].key != parts[p - 1].key;
    }
    r->count = (int32_t)region_count;
    r->start = malloc((region_count + 1) * sizeof *r->start);
    r->volume = malloc(region_count * sizeof *r->volume);
    if (r->start == NULL || r->volume == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    int64_t total = 0;
    int32_t f = 0;
    for (size_t p = 0, q; p < part_count; p = q, f++) {
        for (q = p + 1; q < part_count && parts[q].key == parts[p].key; q++) {
        }
        r->start[f] = total;
        total += gather_nodes(cloud, parts, p, q, seen, node);
    }
    r->start[f] = total;
    r->node = malloc((size_t)total * sizeof *r->node);
    r->gradient = calloc(3 * (size_t)total, sizeof *r->gradient);
    r->region = malloc((size_t)total * sizeof *r->region);
    r->local = malloc((size_t)total * sizeof *r->local);
    r->at_node = malloc(((size_t)cloud->node_count + 1) * sizeof *r->at_node);
    if (r->node == NULL || r->gradient == NULL || r->region == NULL || r->local == NULL ||
        r->at_node == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    f = 0;
    for (size_t p = 0, q; p < part_count; p = q, f++) {
        for (q = p + 1; q < part_count && parts[q].key == parts[p].key; q++) {
        }
        (void)gather_nodes(cloud, parts, p, q, seen, r->node + r->start[f]);
        fill_region(r, f, cloud, parts, p, q, share, seen);
    }
    pal_regions_transpose(r, cloud->node_count);
    return PALPATE_OK;
}

pal_status pal_regions_create(pal_regions *out, const pal_cloud *cloud, pal_region_kind kind,
                              pal_error *error) {
    memset(out, 0, sizeof *out);
    if (cloud->tet_count <= 0) {
        return pal_fail(error, PALPATE_ERROR_CLOUD, "galerkin: the cloud has no cells");
    }
    pal_status status = check_tets(out, cloud, error);
    if (status != PALPATE_OK) {
        return status;
    }
    size_t part_count;
    part *parts = pal_region_parts(cloud, kind, &part_count);
    int32_t *seen = malloc((size_t)cloud->node_count * sizeof *seen);
    int32_t *node = malloc((size_t)cloud->node_count * sizeof *node);
    if (parts == NULL || seen == NULL || node == NULL) {
        status = no_memory(error);
        goto done;
    }
    memset(seen, 0xff, (size_t)cloud->node_count * sizeof *seen);
    double share = 1.0 / (double)parts_per_tet(kind);
    if (regions_fill(out, cloud, parts, part_count, share, seen, node) != PALPATE_OK) {
        status = no_memory(error);
        goto done;
    }
    for (int32_t i = 0; i < cloud->node_count; i++) {
        if (out->at_node[i] == out->at_node[i + 1]) {
            const double *x = cloud->position + 3 * (size_t)i;
            status = pal_fail(error, PALPATE_ERROR_CLOUD,
                              "galerkin: node %d at (%.4g, %.4g, %.4g) belongs to no cell", i,
                              x[0] * cloud->length, x[1] * cloud->length, x[2] * cloud->length);
            goto done;
        }
    }
done:
    free(parts);
    free(seen);
    free(node);
    if (status != PALPATE_OK) {
        pal_regions_clear(out);
    }
    return status;
}

void pal_regions_clear(pal_regions *r) {
    free(r->start);
    free(r->node);
    free(r->gradient);
    free(r->volume);
    free(r->at_node);
    free(r->region);
    free(r->local);
    memset(r, 0, sizeof *r);
}

/// Append the nodes that share a region with a to row; seen[b] == a marks those already there.
static int32_t couple(const pal_regions *r, int32_t a, int32_t *seen, int32_t *row, int32_t count) {
    for (int64_t k = r->at_node[a]; k < r->at_node[a + 1]; k++) {
        int32_t f = r->region[k];
        for (int64_t m = r->start[f]; m < r->start[f + 1]; m++) {
            if (seen[r->node[m]] != a) {
                seen[r->node[m]] = a;
                row[count++] = r->node[m];
            }
        }
    }
    return count;
}

pal_status pal_blocks_create(pal_blocks *out, const pal_regions *regions, const pal_regions *more,
                             int32_t node_count, pal_error *error) {
    memset(out, 0, sizeof *out);
    out->node_count = node_count;
    int32_t *seen = malloc((size_t)node_count * sizeof *seen);
    int32_t *list = malloc((size_t)node_count * sizeof *list);
    out->start = malloc(((size_t)node_count + 1) * sizeof *out->start);
    int ok = seen != NULL && list != NULL && out->start != NULL;
    for (int pass = 0; ok && pass < 2; pass++) { // count, then fill
        memset(seen, 0xff, (size_t)node_count * sizeof *seen);
        int64_t total = 0;
        for (int32_t a = 0; a < node_count; a++) {
            int32_t *row = pass == 0 ? list : out->column + total;
            int32_t count = couple(regions, a, seen, row, 0);
            count = more != NULL ? couple(more, a, seen, row, count) : count;
            if (pass == 1) {
                qsort(row, (size_t)count, sizeof *row, index_compare);
            }
            out->start[a] = total;
            total += count;
        }
        out->start[node_count] = total;
        if (pass == 0) {
            out->column = malloc(((size_t)total + 1) * sizeof *out->column);
            out->value = calloc(9 * (size_t)total + 1, sizeof *out->value);
            ok = out->column != NULL && out->value != NULL;
        }
    }
    free(seen);
    free(list);
    if (!ok) {
        pal_blocks_clear(out);
        return no_memory(error);
    }
    return PALPATE_OK;
}

void pal_blocks_clear(pal_blocks *blocks) {
    free(blocks->start);
    free(blocks->column);
    free(blocks->value);
    memset(blocks, 0, sizeof *blocks);
}

pal_status pal_blocks_add_energy(pal_blocks *blocks, const pal_regions *r, double shear,
                                 double volumetric, const pal_progress *progress,
                                 double progress_from, double progress_to, pal_error *error) {
    enum { ROWS_PER_CALL = 512 };
    int64_t *slot = malloc((size_t)blocks->node_count * sizeof *slot);
    if (slot == NULL) {
        return no_memory(error);
    }
    pal_status status = PALPATE_OK;
    for (int32_t a = 0; a < blocks->node_count && status == PALPATE_OK; a++) {
        for (int64_t k = blocks->start[a]; k < blocks->start[a + 1]; k++) {
            slot[blocks->column[k]] = k;
        }
        for (int64_t k = r->at_node[a]; k < r->at_node[a + 1]; k++) {
            int32_t f = r->region[k];
            const double *ga = r->gradient + 3 * (r->start[f] + r->local[k]);
            double v = r->volume[f];
            for (int64_t m = r->start[f]; m < r->start[f + 1]; m++) {
                const double *gb = r->gradient + 3 * m;
                double *block = blocks->value + 9 * slot[r->node[m]];
                double dot = shear * (ga[0] * gb[0] + ga[1] * gb[1] + ga[2] * gb[2]);
                for (int i = 0; i < 3; i++) {
                    for (int j = 0; j < 3; j++) {
                        double e = shear * (ga[j] * gb[i]) + volumetric * (ga[i] * gb[j]);
                        block[3 * i + j] += v * (i == j ? dot + e : e);
                    }
                }
            }
        }
        if (progress != NULL && progress->call != NULL && a % ROWS_PER_CALL == 0) {
            double done = progress_from + (progress_to - progress_from) * a / blocks->node_count;
            if (progress->call(progress->user, "assemble", done, -1.0) != 0) {
                status = pal_fail(error, PALPATE_ERROR_CANCELLED, "galerkin: cancelled");
            }
        }
    }
    free(slot);
    return status;
}
