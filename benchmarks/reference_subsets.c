/* All subsets by level doubling in C: lanes innermost, symmetric matrices by their upper triangles, no libraries.
 *
 * The same prefixes, blocks and sums as seatrial.selection.subsets: doubling forth, weights, the best structures, sums of
 * inclusion, then moments and spreads of the coefficients back.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 32 };

typedef struct { long size, levels, lanes; double *matrix[MOST], *slope[MOST], *inverse[MOST], *det[MOST], *back[MOST], *scale; } tree;
typedef struct { long most, held; double threshold, *score; long *number; } best;

static long triangle(long n) { return n * (n + 1) / 2; }
static long at(long n, long i, long j) { return i * n - i * (i - 1) / 2 + j - i; }
static double *doubles(long n) { return aligned_alloc(64, ((n * 8 + 63) / 64 + 1) * 64); }

tree *new_tree(long size, long levels, long lanes)
{
    tree *t = calloc(1, sizeof *t);
    t->size = size; t->levels = levels; t->lanes = lanes; t->scale = doubles(lanes << levels);
    for (long v = 0; v <= levels; v++) {
        long n = size - v, m = lanes << v;
        t->matrix[v] = doubles(triangle(n) * m); t->back[v] = doubles(triangle(n) * m); t->det[v] = doubles(m);
        t->slope[v] = doubles((n - 1) * m); t->inverse[v] = doubles(m);
    }
    return t;
}

void free_tree(tree *t)
{
    for (long v = 0; v <= t->levels; v++) { free(t->matrix[v]); free(t->back[v]); free(t->det[v]); free(t->slope[v]); free(t->inverse[v]); }
    free(t->scale); free(t);
}

void eliminate(tree *t)
{
    long lanes = t->lanes;
    for (long v = 0; v < t->levels; v++, lanes *= 2) {
        long n = t->size - v, r = n - 1;
        const double *a = t->matrix[v], *d = t->det[v];
        double *restrict b = t->matrix[v + 1], *restrict slope = t->slope[v], *restrict inverse = t->inverse[v], *restrict e = t->det[v + 1];
        for (long l = 0; l < lanes; l++) { inverse[l] = -1 / a[l]; e[l] = d[l]; e[lanes + l] = d[l] * a[l]; }
        for (long i = 0; i < r; i++)
            for (long l = 0; l < lanes; l++) slope[i * lanes + l] = a[at(n, 0, i + 1) * lanes + l] * inverse[l];
        for (long i = 0; i < r; i++)
            for (long j = i; j < r; j++) {
                const double *rest = a + at(n, i + 1, j + 1) * lanes, *c = a + at(n, 0, j + 1) * lanes, *s = slope + i * lanes;
                double *restrict out = b + at(r, i, j) * 2 * lanes;
                for (long l = 0; l < lanes; l++) { out[l] = rest[l]; out[lanes + l] = rest[l] + s[l] * c[l]; }
            }
    }
}

/* Moments of (coefficients, -1) if `less` is 0; spreads, of the coefficients only, if it is 1, and then of v, too. */
void gather(tree *t, long less)
{
    for (long v = t->levels - 1; v >= 0; v--) {
        long lanes = t->lanes << v, n = t->size - v - less, r = n - 1;
        const double *q = t->back[v + 1], *slope = t->slope[v];
        double *restrict out = t->back[v], *restrict top = out, *restrict scale = t->scale;
        for (long i = 0; i < r; i++)
            for (long j = i; j < r; j++) {
                const double *half = q + at(r, i, j) * 2 * lanes;
                double *restrict o = out + at(n, i + 1, j + 1) * lanes;
                for (long l = 0; l < lanes; l++) o[l] = half[l] + half[lanes + l];
            }
        for (long i = 0; i < r; i++) {
            double *restrict o = out + at(n, 0, i + 1) * lanes;
            memset(o, 0, lanes * sizeof *o);
            for (long j = 0; j < r; j++) {
                const double *present = q + (i < j ? at(r, i, j) : at(r, j, i)) * 2 * lanes + lanes, *s = slope + j * lanes;
                for (long l = 0; l < lanes; l++) o[l] += present[l] * s[l];
            }
        }
        if (less) for (long l = 0; l < lanes; l++) { top[l] = -t->inverse[v][l] * scale[lanes + l]; scale[l] += scale[lanes + l]; }
        else memset(top, 0, lanes * sizeof *top);
        for (long i = 0; i < r; i++) {
            const double *o = out + at(n, 0, i + 1) * lanes, *s = slope + i * lanes;
            for (long l = 0; l < lanes; l++) top[l] += o[l] * s[l];
        }
    }
}

static int falling(const void *x, const void *y)
{
    double a = **(double *const *)x, b = **(double *const *)y;
    return (a < b) - (a > b);
}

static void compact(best *b)
{
    if (b->held <= b->most) return;
    double **order = malloc(b->held * sizeof *order), *score = doubles(b->most);
    long *number = malloc(b->most * sizeof *number);
    for (long i = 0; i < b->held; i++) order[i] = b->score + i;
    qsort(order, b->held, sizeof *order, falling);
    for (long i = 0; i < b->most; i++) { score[i] = *order[i]; number[i] = b->number[order[i] - b->score]; }
    memcpy(b->score, score, b->most * sizeof *score); memcpy(b->number, number, b->most * sizeof *number);
    b->held = b->most; b->threshold = score[b->most - 1];
    free(order); free(score); free(number);
}

best *new_best(long most)
{
    best *b = malloc(sizeof *b);
    *b = (best){most, 0, -1e300, doubles(8 * most), malloc(8 * most * sizeof(long))};
    return b;
}

long ranked(best *b, double *score, long *number)
{
    compact(b);
    memcpy(score, b->score, b->held * sizeof *score); memcpy(number, b->number, b->held * sizeof *number);
    long held = b->held;
    free(b->score); free(b->number); free(b);
    return held;
}

static void copy_lanes(long rows, long lanes, const double *from, long first, double *to, long width, int back)
{
    for (long i = 0; i < rows; i++)
        if (back) memcpy((double *)from + i * lanes + first, to + i * width, width * sizeof *to);
        else memcpy(to + i * width, from + i * lanes + first, width * sizeof *to);
}

/* Blocks number first, first + step, ... below last; sums are those of `Sums`, matrices packed. */
void add_blocks(tree *outer, long levels, long width, long first, long last, long step, double shape, double negligible, best *b,
                double *peak, double *weight, double *corner_sum, double *present, double *pairs, double *moment, double *spread)
{
    long size = levels + 1, lanes = outer->lanes << outer->levels, m = 1l << levels, count = m * width, blocks = lanes / width;
    tree *t = new_tree(size, levels, width);
    double *score = doubles(count), *w = doubles(count);
    for (long block = first; block < last; block += step) {
        long lane = block * width;
        copy_lanes(triangle(size), lanes, outer->matrix[outer->levels], lane, t->matrix[0], width, 0);
        copy_lanes(1, lanes, outer->det[outer->levels], lane, t->det[0], width, 0);
        eliminate(t);
        const double *corner = t->matrix[levels], *det = t->det[levels];
        double top = -1e300;
        for (long l = 0; l < count; l++) score[l] = -shape * log(corner[l]) - 0.5 * log(det[l]);
        for (long l = 0; l < count; l++) top = score[l] > top ? score[l] : top;
        for (long l = 0; l < count; l++)
            if (score[l] >= b->threshold) {
                b->score[b->held] = score[l];
                b->number[b->held++] = (l / width << outer->levels) + lane + l % width;
                if (b->held == 8 * b->most) compact(b);
            }
        if (!(top > negligible)) continue;
        for (long l = 0; l < count; l++) w[l] = exp(score[l] - top);
        for (long l = 0; l < width; l++) peak[lane + l] = top;
        memcpy(t->back[levels], w, count * sizeof *w);
        gather(t, 0);
        copy_lanes(triangle(size), lanes, moment, lane, t->back[0], width, 1);
        for (long l = 0; l < count; l++) t->scale[l] = w[l] * corner[l];
        gather(t, 1);
        copy_lanes(triangle(levels), lanes, spread, lane, t->back[0], width, 1);
        memcpy(corner_sum + lane, t->scale, width * sizeof *w);
        for (long s = 0; s < m; s++) {
            double sum = 0;
            for (long l = 0; l < width; l++) sum += w[s * width + l];
            for (long i = 0; i < levels; i++)
                for (long j = 0; j < levels; j++) pairs[(i * levels + j) * blocks + block] += s >> i & s >> j & 1 ? sum : 0;
        }
        for (long term = levels - 1; term >= 0; term--) {
            long half = width << term;
            double *restrict p = present + term * lanes + lane;
            memset(p, 0, width * sizeof *p);
            for (long s = 0; s < 1l << term; s++)
                for (long l = 0; l < width; l++) p[l] += w[half + s * width + l];
            for (long l = 0; l < half; l++) w[l] += w[half + l];
        }
        memcpy(weight + lane, w, width * sizeof *w);
    }
    free(score); free(w); free_tree(t);
}

/* Access to the outer tree: its first matrix, its last moments or spreads, and what comes back. */
void give(tree *t, const double *matrix, double start)
{
    memcpy(t->matrix[0], matrix, triangle(t->size) * sizeof *matrix);
    t->det[0][0] = start;
}

void take_back(tree *t, long less, const double *fine, const double *scale, double *coarse)
{
    long n = t->size - t->levels - less, lanes = t->lanes << t->levels;
    memcpy(t->back[t->levels], fine, triangle(n) * lanes * sizeof *fine);
    if (less) memcpy(t->scale, scale, lanes * sizeof *scale);
    gather(t, less);
    memcpy(coarse, t->back[0], triangle(t->size - less) * t->lanes * sizeof *coarse);
}

static void sweep(long n, double *a, long pivot, double *log_det)
{
    double d = a[pivot * n + pivot], column[MOST], sign = d > 0 ? 1 : -1;
    *log_det += log(sign * d);
    for (long i = 0; i < n; i++) column[i] = a[i * n + pivot];
    for (long i = 0; i < n; i++) {
        double f = column[i] / d;
        for (long j = 0; j < n; j++) a[i * n + j] -= f * column[j];
    }
    for (long i = 0; i < n; i++) a[i * n + pivot] = a[pivot * n + i] = sign * column[i] / d;
    a[pivot * n + pivot] = -1 / d;
}

/* Log of the sum over all subsets of the first k - held terms, the last ones set as `there` says: one sweep for each subset. */
double gray_code(long k, long held, long there, const double *matrix, double start, double shape)
{
    long n = k + 1;
    double a[MOST * MOST], log_det = log(start), top = -1e300, sum = 0;
    memcpy(a, matrix, n * n * sizeof *a);
    for (long i = 0; i < held; i++) if (there >> i & 1) sweep(n, a, k - held + i, &log_det);
    for (long s = 0; s < 1l << (k - held); s++) {
        if (s) sweep(n, a, __builtin_ctzl(s), &log_det);
        double score = -shape * log(a[n * n - 1]) - 0.5 * log_det;
        if (score > top) { sum = sum * exp(top - score) + 1; top = score; }
        else sum += exp(score - top);
    }
    return top + log(sum);
}
