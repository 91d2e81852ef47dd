/* Runs a model that is composed of functions: nothing in here is compiled for a model.
 *
 * All numbers of an instant (time, drive, channels, states, parameters, signals) are slots of one
 * array; the derivatives of each by all directions lie beside it as rows. A model is a list of
 * operations, each a function and the slots of its inputs and outputs, in an order in which every
 * one finds its inputs computed. Which parameter is which direction is data: a one in its row.
 *
 * Scheme: classical Runge-Kutta, in which linear blocks of one or two states are moved by their
 * exponential where the plan says so (ETD4RK; see scheme.py and exponential.py).
 */
#include "core.h"

typedef struct {
    po_prepare *prepare_plain;
    po_evaluate *plain;
    po_prepare *prepare_moved;
    po_evaluate *moved;
    int64_t at, kept_plain, kept_moved;
} po_operation;

typedef struct { int64_t first, count; } po_list;

/* A block's states as places in the list of moving states; the slots of L, row by row. */
typedef struct { int64_t size, moving[2], quiet[2], matrix[4], weights; } po_block;

typedef struct {
    const po_operation *operations;
    const int *slots;
    const int *constants;
    const double *constant;
    const int *moving, *rates; /* states that move, and the slots of their rates */
    const int *plain;          /* places in that list of those in no block */
    const int *jumping, *after; /* states that jump, and the slots of what they become */
    const po_block *blocks;
    po_list once, weigh, stage, reading, jump, start;
    int64_t count, kept_plain, kept_moved, states, parameters, channels, n_constants, n_moving,
        n_plain, n_jumping, n_blocks, n_weights;
    int64_t time, drive, slope, channel, channel_slope, state, parameter, deviation, length,
        weights, read;
} po_plan;

#if defined(__SSE2__)
/* Derivatives by where a state began fade to the smallest numbers there are and stay, and a
   processor may take far longer over those: they are zero within a function that says PO_FLUSH. */
static inline unsigned po_flush(void)
{
    const unsigned kept = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(kept | 0x8040u); /* results, and operands */
    return kept;
}
static inline void po_restore(const unsigned *const kept) { __builtin_ia32_ldmxcsr(*kept); }
#define PO_FLUSH const unsigned po_was __attribute__((cleanup(po_restore))) = po_flush();
#else
#define PO_FLUSH
#endif

#define INLINE static inline __attribute__((always_inline))
#define ROWS for (long g = 0; g < N; ++g)
enum { LENGTHS = 16 };

/* Sum of terms, A: their number, where it goes, then slot and sign of each. */
void po_sum(const int *A, double *V, const double *K, po_row *T, long N)
{
    const int m = A[0], *const of = A + 2;
    double sum = of[1] * V[of[0]];
    for (int i = 1; i < m; ++i) sum += of[2 * i + 1] * V[of[2 * i]];
    V[A[1]] = sum;
    po_row *const out = T + N * A[1];
    ROWS {
        po_row all = (double)of[1] * T[N * of[0] + g];
        for (int i = 1; i < m; ++i) all += (double)of[2 * i + 1] * T[N * of[2 * i] + g];
        out[g] = all;
    }
}

/* A: first factor, second factor, product. */
void po_product(const int *A, double *V, const double *K, po_row *T, long N)
{
    const double a = V[A[0]], b = V[A[1]];
    V[A[2]] = a * b;
    ROWS T[N * A[2] + g] = b * T[N * A[0] + g] + a * T[N * A[1] + g];
}

/* A: what is divided, by what, where it goes. */
void po_quotient(const int *A, double *V, const double *K, po_row *T, long N)
{
    const double by = 1.0 / V[A[1]], q = V[A[0]] * by;
    V[A[2]] = q;
    ROWS T[N * A[2] + g] = by * (T[N * A[0] + g] - q * T[N * A[1] + g]);
}

void po_nothing(const int *A, const double *V, double *K) {}

/* Working memory of one run. */
typedef struct {
    double *v, *k, *x, *n, *a, *kept;
    po_row *t, *X, *R, *B, *K, *clock;
} po_memory;

INLINE double *carve(double **const left, const int64_t count)
{
    double *const here = *left;
    *left += (count + 7) / 8 * 8;
    return here;
}

static void *make(const po_plan *const p, po_memory *const m, const long N)
{
    const int64_t moving = p->n_moving + 1, w = p->n_weights + 2;
    const int64_t k = N ? p->kept_moved : p->kept_plain;
    const int64_t numbers = p->count + k + p->states + 5 * moving + LENGTHS * w + 64 * 8;
    const int64_t rows = p->count + p->states + 5 * moving + LENGTHS * w + 2;
    const int64_t bytes = 8 * (numbers + 64) + 64 * rows * N + 64;
    void *const all = malloc(bytes);
    if (!all) return NULL;
    memset(all, 0, bytes);
    double *left = (double *)(((uintptr_t)all + 63) / 64 * 64);
    m->v = carve(&left, p->count);
    m->k = carve(&left, k);
    m->x = carve(&left, p->states);
    m->n = carve(&left, 4 * moving);
    m->a = carve(&left, moving);
    m->kept = carve(&left, LENGTHS * w);
    m->t = (po_row *)carve(&left, 8 * N * p->count);
    m->X = (po_row *)carve(&left, 8 * N * p->states);
    m->R = (po_row *)carve(&left, 8 * N * 4 * moving);
    m->B = (po_row *)carve(&left, 8 * N * moving);
    m->K = (po_row *)carve(&left, 8 * N * LENGTHS * w);
    m->clock = (po_row *)carve(&left, 8 * N);
    return all;
}

INLINE void evaluate(const po_plan *const p, const po_memory *const m, const po_list list,
                     const long N)
{
    const po_operation *const end = p->operations + list.first + list.count;
    for (const po_operation *o = p->operations + list.first; o < end; ++o)
        if (N) o->moved(p->slots + o->at, m->v, m->k + o->kept_moved, m->t, N);
        else o->plain(p->slots + o->at, m->v, m->k + o->kept_plain, m->t, 0);
}

static void prepare(const po_plan *const p, const po_memory *const m, const po_list list,
                    const long N)
{
    const po_operation *const end = p->operations + list.first + list.count;
    for (const po_operation *o = p->operations + list.first; o < end; ++o)
        if (N) o->prepare_moved(p->slots + o->at, m->v, m->k + o->kept_moved);
        else o->prepare_plain(p->slots + o->at, m->v, m->k + o->kept_plain);
}

/* Parameters, constants and directions. MOVES: for each of D directions the slot whose row has a
   one there, or -1. */
static void begin(const po_plan *const p, const po_memory *const m, const double *const P,
                  const int *const MOVES, const long D, const long N)
{
    for (int64_t i = 0; i < p->n_constants; ++i) m->v[p->constants[i]] = p->constant[i];
    for (int64_t i = 0; i < p->parameters; ++i) m->v[p->parameter + i] = P[i];
    for (long d = 0; d < D; ++d)
        if (MOVES[d] >= 0) ((double *)(m->t + N * MOVES[d]))[d] = 1.0;
}

/* States X and their sensitivities S (row-major) at rest at time T under drive U and channels C,
   plus the deviation DX. Returns 0 unless there is no memory. */
int po_start(const po_plan *const p, const double *T, const double *U, const double *C,
             const double *P, const double *DX, const int *MOVES, const long D, double *X,
             double *S)
{
    PO_FLUSH
    const long N = (D + 7) / 8;
    po_memory memory, *const m = &memory;
    void *const all = make(p, m, N);
    if (!all) return 1;
    begin(p, m, P, MOVES, D, N);
    m->v[p->time] = *T;
    m->v[p->drive] = *U;
    for (int64_t i = 0; i < p->channels; ++i) m->v[p->channel + i] = C[i];
    for (int64_t i = 0; i < p->states; ++i) m->v[p->deviation + i] = DX[i];
    prepare(p, m, p->start, N);
    evaluate(p, m, p->start, N);
    for (int64_t i = 0; i < p->states; ++i) {
        X[i] = m->v[p->state + i];
        for (long d = 0; d < D; ++d) S[i * D + d] = ((double *)(m->t + N * (p->state + i)))[d];
    }
    free(all);
    return 0;
}

/* The matrix L of the blocks (row-major), and the slopes A of what is left of the rates by the
   states, at one instant; A may be null. */
int po_slopes(const po_plan *const p, const double T, const double U, const double DU,
              const double *C, const double *DC, const double *P, const double *X, double *L,
              double *A)
{
    PO_FLUSH
    const long n = p->states, N = A ? (n + 7) / 8 : 0;
    po_memory memory, *const m = &memory;
    void *const all = make(p, m, N);
    if (!all) return 1;
    begin(p, m, P, NULL, 0, N);
    memset(L, 0, sizeof(double) * n * n);
    prepare(p, m, p->once, N);
    evaluate(p, m, p->once, N);
    for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b)
        for (int i = 0; i < b->size; ++i)
            for (int j = 0; j < b->size; ++j)
                L[p->moving[b->moving[i]] * n + p->moving[b->moving[j]]] =
                    m->v[b->matrix[b->size * i + j]];
    if (A) {
        m->v[p->time] = T;
        m->v[p->drive] = U;
        m->v[p->slope] = DU;
        for (int64_t i = 0; i < p->channels; ++i) {
            m->v[p->channel + i] = C[i];
            m->v[p->channel_slope + i] = DC[i];
        }
        for (long i = 0; i < n; ++i) {
            m->v[p->state + i] = X[i];
            ((double *)(m->t + N * (p->state + i)))[i] = 1.0;
        }
        prepare(p, m, p->stage, N);
        evaluate(p, m, p->stage, N);
        memset(A, 0, sizeof(double) * n * n);
        for (int64_t i = 0; i < p->n_moving; ++i)
            for (long j = 0; j < n; ++j)
                A[p->moving[i] * n + j] = ((double *)(m->t + N * p->rates[i]))[j];
        for (long i = 0; i < n * n; ++i) A[i] -= L[i];
    }
    free(all);
    return 0;
}

typedef struct {
    const double *H; const int *NSUB; const double *T, *U, *DU, *C, *DC, *HT, *UT, *TT, *CT;
    const int *OBS;
} po_segments;

typedef struct {
    const double *P;
    const int *MOVES, *CLOCKS;
    long D;
    double *X, *S, *Y, *J, *XO;
    const double *M;
    double most;
} po_wanted;

/* Rates of the moving states less what their blocks take over, as stage s. */
INLINE void rates(const po_plan *const p, const po_memory *const m, const int s, const long N)
{
    const int64_t count = p->n_moving;
    double *const n = m->n + s * (count + 1);
    po_row *const R = m->R + N * s * (count + 1);
    evaluate(p, m, p->stage, N);
    for (int64_t i = 0; i < count; ++i) {
        n[i] = m->v[p->rates[i]];
        ROWS R[N * i + g] = m->t[N * p->rates[i] + g];
    }
    for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b)
        for (int i = 0; i < b->size; ++i) {
            const int64_t at = b->moving[i];
            if (b->quiet[i]) continue;
            for (int j = 0; j < b->size; ++j) {
                const int64_t l = b->matrix[b->size * i + j];
                const int64_t x = p->state + p->moving[b->moving[j]];
                const double by = m->v[l], of = m->v[x];
                n[at] -= by * of;
                ROWS R[N * at + g] -= by * m->t[N * x + g] + of * m->t[N * l + g];
            }
        }
}

/* Where the instant's own numbers are, a share of a sub-step after its beginning. */
typedef struct { double t, u, du, tT, uT; const double *c, *dc, *cT; } po_instant;

INLINE void place(const po_plan *const p, const po_memory *const m, const po_instant *const at,
                  const double past, const double pastT, const int delayed, const long N)
{
    m->v[p->time] = at->t + past;
    m->v[p->drive] = at->u + at->du * past;
    for (int64_t i = 0; i < p->channels; ++i)
        m->v[p->channel + i] = at->c[i] + at->dc[i] * past;
    if (delayed) ROWS {
        m->t[N * p->time + g] = (at->tT + pastT) * m->clock[g];
        m->t[N * p->drive + g] = (at->uT + at->du * pastT) * m->clock[g];
        for (int64_t i = 0; i < p->channels; ++i)
            m->t[N * (p->channel + i) + g] = (at->cT[i] + at->dc[i] * pastT) * m->clock[g];
    }
}

/* States of no block a way of h along a stage's rates from where the sub-step began. */
INLINE void plainly(const po_plan *const p, const po_memory *const m, const int s, const double h,
                    const double hT, const int delayed, const long N)
{
    const double *const n = m->n + s * (p->n_moving + 1);
    const po_row *const R = m->R + N * s * (p->n_moving + 1);
    for (int64_t i = 0; i < p->n_plain; ++i) {
        const int64_t at = p->plain[i], x = p->moving[at];
        m->v[p->state + x] = m->x[x] + h * n[at];
        po_row *const to = m->t + N * (p->state + x);
        ROWS to[g] = m->X[N * x + g] + h * R[N * at + g];
        if (delayed) ROWS to[g] += (n[at] * hT) * m->clock[g];
    }
}

/* For block b entry i: sum over j of weights from slot w times numbers (place j in the list of
   moving states) and their rows, added up. */
INLINE void weighed(const po_block *const b, const double *const W, const po_row *const WR,
                    const int which, const int i, const double *const of, const po_row *const OF,
                    const int skip_quiet, double *const sum, po_row *const all, const long N)
{
    const int64_t size = b->size, first = b->weights + which * size * size + size * i;
    for (int j = 0; j < size; ++j) {
        if (skip_quiet && b->quiet[j]) continue;
        const int64_t at = b->moving[j];
        const double w = W[first + j], x = of[at];
        *sum += w * x;
        ROWS all[g] += w * OF[N * at + g] + x * WR[N * (first + j) + g];
    }
}

enum { HALF, HALF_INPUT, WHOLE, FIRST, MIDDLE, LAST };

INLINE void walk(const po_plan *const p, const po_memory *const m, const long n,
                 const po_segments *const s, const po_wanted *const to, const int delayed,
                 const long N)
{
    const int64_t nx = p->states, nc = p->channels, count = p->n_moving, nw = p->n_weights;
    const int64_t stride = count + 1, wide = nw + 2;
    double *const now = m->v + p->state;
    po_row *const NOW = m->t + N * p->state;
    double c[nc + 1], cT[nc + 1], begun[stride], input[stride];
    po_row BEGUN[N * stride + 1], INPUT[N * stride + 1];
    double squares = 0.0;
    int known = 0, next = 0, at = 0;
    double *W = m->kept;
    po_row *WR = m->K;

    prepare(p, m, p->once, N);
    evaluate(p, m, p->once, N);
    prepare(p, m, p->weigh, N);
    prepare(p, m, p->stage, N);
    prepare(p, m, p->reading, N);
    prepare(p, m, p->jump, N);
    for (long j = 0; j < n; ++j) {
        const int cuts = s->NSUB[j];
        const double h = cuts > 0 ? s->H[j] / cuts : 0.0;
        const double hT = delayed && cuts > 0 ? s->HT[j] / cuts : 0.0;
        if (nw && (j == 0 || W[nw] != h || (delayed && W[nw + 1] != hT))) {
            for (at = 0; at < known; ++at) {
                const double *const one = m->kept + at * wide;
                if (one[nw] == h && one[nw + 1] == hT) break;
            }
            W = m->kept + at * wide;
            WR = m->K + N * at * wide;
            if (at == known) {
                if (known < LENGTHS) ++known;
                else at = next;
                next = (next + 1) % LENGTHS;
                W = m->kept + at * wide;
                WR = m->K + N * at * wide;
                m->v[p->length] = h;
                ROWS m->t[N * p->length + g] = hT * m->clock[g];
                evaluate(p, m, p->weigh, N);
                memcpy(W, m->v + p->weights, nw * sizeof(double));
                memcpy(WR, m->t + N * p->weights, N * nw * sizeof(po_row));
                W[nw] = h;
                W[nw + 1] = hT;
            }
        }
        po_instant i = {s->T[j], s->U[j], s->DU[j], 0.0, 0.0, c, s->DC + j * nc, cT};
        for (int64_t a = 0; a < nc; ++a) {
            c[a] = s->C[j * nc + a];
            m->v[p->channel_slope + a] = i.dc[a];
        }
        if (delayed) {
            i.tT = s->TT[j];
            i.uT = s->UT[j];
            for (int64_t a = 0; a < nc; ++a) cT[a] = s->CT[j * nc + a];
        }
        m->v[p->slope] = i.du;
        const double half = 0.5 * h, halfT = 0.5 * hT;
        for (int cut = 0; cut < cuts; ++cut) {
            place(p, m, &i, 0.0, 0.0, delayed, N);
            rates(p, m, 0, N);
            for (int64_t a = 0; a < count; ++a) {
                begun[a] = m->x[p->moving[a]];
                ROWS BEGUN[N * a + g] = m->X[N * p->moving[a] + g];
            }
            place(p, m, &i, half, halfT, delayed, N);
            for (int stage = 1; stage < 4; ++stage) {
                /* The first two half-steps go from the beginning, the last from the first one's
                   end along 2 n3 - n1. */
                const double *from = begun, *along = m->n + (stage - 1) * stride;
                const po_row *FROM = BEGUN, *ALONG = m->R + N * (stage - 1) * stride;
                if (stage == 3) {
                    place(p, m, &i, h, hT, delayed, N);
                    plainly(p, m, 2, h, hT, delayed, N);
                    if (p->n_blocks) for (int64_t a = 0; a < count; ++a) {
                        input[a] = 2.0 * along[a] - m->n[a];
                        ROWS INPUT[N * a + g] = 2.0 * ALONG[N * a + g] - m->R[N * a + g];
                    }
                    from = m->a, FROM = m->B, along = input, ALONG = INPUT;
                } else
                    plainly(p, m, stage - 1, half, halfT, delayed, N);
                for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b)
                    for (int e = 0; e < b->size; ++e) {
                        double sum = 0.0;
                        po_row all[N + 1];
                        ROWS all[g] = (po_row){0};
                        weighed(b, W, WR, HALF, e, from, FROM, 0, &sum, all, N);
                        weighed(b, W, WR, HALF_INPUT, e, along, ALONG, 1, &sum, all, N);
                        const int64_t x = p->moving[b->moving[e]];
                        now[x] = sum;
                        ROWS NOW[N * x + g] = all[g];
                        if (stage == 1) {
                            m->a[b->moving[e]] = sum;
                            ROWS m->B[N * b->moving[e] + g] = all[g];
                        }
                    }
                rates(p, m, stage, N);
            }
            const double h6 = h * (1.0 / 6.0), h6T = hT * (1.0 / 6.0);
            const double *const n1 = m->n, *const n2 = n1 + stride, *const n3 = n2 + stride;
            const double *const n4 = n3 + stride;
            const po_row *const R1 = m->R, *const R2 = R1 + N * stride;
            const po_row *const R3 = R2 + N * stride, *const R4 = R3 + N * stride;
            for (int64_t a = 0; a < p->n_plain; ++a) {
                const int64_t k = p->plain[a], x = p->moving[k];
                const double way = n1[k] + 2.0 * (n2[k] + n3[k]) + n4[k];
                m->x[x] = begun[k] + h6 * way;
                ROWS m->X[N * x + g] += h6 * (R1[N * k + g]
                    + 2.0 * (R2[N * k + g] + R3[N * k + g]) + R4[N * k + g]);
                if (delayed) ROWS m->X[N * x + g] += (h6T * way) * m->clock[g];
                now[x] = m->x[x];
                ROWS NOW[N * x + g] = m->X[N * x + g];
            }
            if (p->n_blocks) for (int64_t a = 0; a < count; ++a) {
                input[a] = n2[a] + n3[a];
                ROWS INPUT[N * a + g] = R2[N * a + g] + R3[N * a + g];
            }
            for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b)
                for (int e = 0; e < b->size; ++e) {
                    double sum = 0.0;
                    po_row all[N + 1];
                    ROWS all[g] = (po_row){0};
                    weighed(b, W, WR, WHOLE, e, begun, BEGUN, 0, &sum, all, N);
                    weighed(b, W, WR, FIRST, e, n1, R1, 1, &sum, all, N);
                    weighed(b, W, WR, MIDDLE, e, input, INPUT, 1, &sum, all, N);
                    weighed(b, W, WR, LAST, e, n4, R4, 1, &sum, all, N);
                    const int64_t x = p->moving[b->moving[e]];
                    m->x[x] = now[x] = sum;
                    ROWS m->X[N * x + g] = NOW[N * x + g] = all[g];
                }
            if (p->n_jumping) {
                evaluate(p, m, p->jump, N);
                for (int64_t a = 0; a < p->n_jumping; ++a) {
                    const int64_t x = p->jumping[a];
                    m->x[x] = m->v[p->after[a]];
                    ROWS m->X[N * x + g] = m->t[N * p->after[a] + g];
                }
                for (int64_t a = 0; a < p->n_jumping; ++a) {
                    const int64_t x = p->jumping[a];
                    now[x] = m->x[x];
                    ROWS NOW[N * x + g] = m->X[N * x + g];
                }
            }
            i.t += h;
            i.u += i.du * h;
            for (int64_t a = 0; a < nc; ++a) c[a] += i.dc[a] * h;
            if (delayed) {
                i.tT += hT;
                i.uT += i.du * hT;
                for (int64_t a = 0; a < nc; ++a) cT[a] += i.dc[a] * hT;
            }
        }
        const long k = s->OBS[j];
        if (k < 0) continue;
        place(p, m, &i, 0.0, 0.0, delayed, N);
        evaluate(p, m, p->reading, N);
        const double y = to->Y[k] = m->v[p->read];
        const double *const slopes = (double *)(m->t + N * p->read);
        for (long d = 0; d < to->D; ++d) to->J[k * to->D + d] = slopes[d];
        if (to->M && to->M[k] == to->M[k]) {
            squares += (y - to->M[k]) * (y - to->M[k]);
            if (!(squares <= to->most)) return;
        }
        if (to->XO) memcpy(to->XO + k * nx, m->x, nx * sizeof(double));
    }
    memcpy(to->X, m->x, nx * sizeof(double));
    for (int64_t a = 0; a < nx; ++a)
        for (long d = 0; d < to->D; ++d)
            to->S[a * to->D + d] = ((double *)(m->X + N * a))[d];
}

/* n segments: length H [s], sub-steps NSUB, start time T, drive U with slope DU, channels C with
   slopes DC (row-major), derivatives by the delay HT, UT, TT, CT; OBS is the index of the reading
   taken at the segment's end, or -1. X and S hold the states and their sensitivities (row-major)
   at the start on entry and at the end on return; Y, J, XO take readings, their sensitivities
   (row-major) and, if XO is not null, the states at the readings. CLOCKS: for each direction
   whether it moves the clock of the whole chain; null where none does. If M is not null the run
   ends, its results unfinished, as soon as the sum of squares of the readings minus M exceeds the
   most or is none; entries of M that are NaN do not count. Returns 0 unless there is no memory. */
int po_run(const po_plan *const p, const long n, const po_segments *const s,
           const po_wanted *const to)
{
    PO_FLUSH
    const long D = to->D, N = (D + 7) / 8;
    po_memory memory, *const m = &memory;
    void *const all = make(p, m, N);
    if (!all) return 1;
    begin(p, m, to->P, to->MOVES, D, N);
    memcpy(m->x, to->X, p->states * sizeof(double));
    memcpy(m->v + p->state, to->X, p->states * sizeof(double));
    for (int64_t a = 0; a < p->states; ++a)
        for (long d = 0; d < D; ++d)
            ((double *)(m->X + N * a))[d] = ((double *)(m->t + N * (p->state + a)))[d] =
                to->S[a * D + d];
    if (to->CLOCKS) for (long d = 0; d < D; ++d) ((double *)m->clock)[d] = to->CLOCKS[d];
    const int delayed = to->CLOCKS && N;
    if (N == 0) walk(p, m, n, s, to, 0, 0);
    else if (delayed) walk(p, m, n, s, to, 1, N);
    else if (N == 1) walk(p, m, n, s, to, 0, 1);
    else if (N == 2) walk(p, m, n, s, to, 0, 2);
    else walk(p, m, n, s, to, 0, N);
    free(all);
    return 0;
}
