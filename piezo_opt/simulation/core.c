/* Runs a model that is composed of functions: nothing in here is compiled for a model.
 *
 * All numbers of an instant (time, drive, channels, states, parameters, signals) are slots of one
 * array; the derivatives of each by all directions lie behind it as rows. A model is a list of
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
    const po_word *words_plain, *words_moved;
    int64_t at, inputs, kept_plain, kept_moved;
} po_operation;

typedef struct { int64_t first, count; } po_list;

/* A linear block: slots of its states and of their rates, of its matrix L row by row, where its
   weights begin, which of its rates are nothing but the block's own, whether the block's share is
   in its rates and has to be taken out, and whether anything within a sub-step follows it. */
typedef struct {
    int64_t size, state[2], rate[2], quiet[2], matrix[4], weights, whole, followed;
} po_block;

typedef struct {
    const po_operation *operations;
    const int *slots;
    const int *constants;
    const double *constant;
    const int *moving, *rates; /* slots of the states of no block, and of their rates */
    const int *jumping, *after; /* slots of the states that jump, and of what they become */
    const int *ends; /* slots of what is driven and read by others */
    const po_block *blocks;
    po_list once, weigh, driven, stage, reading, jump, start;
    int64_t count, n_slots, kept_plain, kept_moved, states, parameters, channels, n_constants,
        n_moving, n_jumping, n_ends, n_blocks, n_weights;
    int64_t time, drive, slope, channel, channel_slope, state, parameter, deviation, length,
        weights, read;
} po_plan;

#define INLINE static inline __attribute__((always_inline))
#define ROWS for (long g = 0; g < N; ++g)
enum { LENGTHS = 16 };
enum { HALF, HALF_INPUT, WHOLE, FIRST, MIDDLE, LAST }; /* kinds of weights */

/* Bytes from one slot to the next, with N rows behind each number. */
#define STRIDE(N) ((N) ? 64 * ((N) + 1) : 8)

#define TERM(i) (PO_NUMBER(A[2 * (i) + 2]) * PO_NUMBER(A[2 * (i) + 1]))
#define TERM_ROW(i) (PO_NUMBER(A[2 * (i) + 2]) * PO_ROWS(A[2 * (i) + 1])[g])
#define SUM(name, terms, rows)                                                                     \
    void name(const int *A, char *B, const double *K, long N)                                      \
    {                                                                                              \
        PO_NUMBER(A[0]) = terms;                                                                   \
        po_row *const out = PO_ROWS(A[0]);                                                         \
        ROWS out[g] = rows;                                                                        \
    }
/* A: the sum, then of each term where it is and where its sign is. */
SUM(po_sum_1, TERM(0), TERM_ROW(0))
SUM(po_sum_2, TERM(0) + TERM(1), TERM_ROW(0) + TERM_ROW(1))
SUM(po_sum_3, TERM(0) + TERM(1) + TERM(2), TERM_ROW(0) + TERM_ROW(1) + TERM_ROW(2))
SUM(po_sum_4, TERM(0) + TERM(1) + TERM(2) + TERM(3),
    TERM_ROW(0) + TERM_ROW(1) + TERM_ROW(2) + TERM_ROW(3))

/* A: first factor, second factor, product. */
void po_product(const int *A, char *B, const double *K, long N)
{
    const double a = PO_NUMBER(A[0]), b = PO_NUMBER(A[1]);
    PO_NUMBER(A[2]) = a * b;
    ROWS PO_ROWS(A[2])[g] = b * PO_ROWS(A[0])[g] + a * PO_ROWS(A[1])[g];
}

/* A: what is divided, by what, where it goes. */
void po_quotient(const int *A, char *B, const double *K, long N)
{
    const double by = 1.0 / PO_NUMBER(A[1]), q = PO_NUMBER(A[0]) * by;
    PO_NUMBER(A[2]) = q;
    ROWS PO_ROWS(A[2])[g] = by * (PO_ROWS(A[0])[g] - q * PO_ROWS(A[1])[g]);
}

void po_nothing(const int *A, const char *B, double *K) {}

/* Machine code that moves a plan by a sub-step, and that takes a reading: see machine.h. W and WR are
   the weights of the blocks. */
typedef void po_machine(char *b, const double *W, const po_row *WR);

/* several: so many samples of a sub-step each at once, if more than one; groups: of each slot the
   groups of four directions that may move it; spills: bytes behind the memory of a run that it
   writes to. */
typedef struct {
    po_machine *step, *reading, *several;
    void *memory;
    uint64_t *groups;
    int64_t count, bytes, spills, states, first;
} po_code;
enum { SEVERAL = 4 };

/* Working memory of one run: slots, what preparations keep, places of the operations' slots; where
   a sub-step began, what its stages add up to, and the rates of the blocks at each stage. */
typedef struct {
    char *b;
    int *at;
    double *k, *x, *sum, *kept, *bx, *ba, *bn, *instant, *several, *read;
    po_row *X, *SUM, *K, *BX, *BA, *BN, *clock;
} po_memory;

/* Where each of them is, in bytes. */
typedef struct {
    int64_t b, at, k, x, sum, kept, bx, ba, bn, X, SUM, K, BX, BA, BN, clock, instant, several,
        read, bytes;
} po_layout;

static int64_t carve(po_layout *const l, const int64_t bytes)
{
    const int64_t here = l->bytes;
    l->bytes += (bytes + 63) / 64 * 64;
    return here;
}

static po_layout layout(const po_plan *const p, const long N)
{
    const int64_t w = p->n_weights + 2, k = N ? p->kept_moved : p->kept_plain;
    const int64_t moving = p->n_moving + 1, blocks = 2 * p->n_blocks + 1;
    po_layout l = {0};
    l.b = carve(&l, STRIDE(N) * p->count);
    l.at = carve(&l, 4 * p->n_slots);
    l.k = carve(&l, 8 * k);
    l.x = carve(&l, 8 * moving);
    l.sum = carve(&l, 8 * moving);
    l.kept = carve(&l, 8 * LENGTHS * w);
    l.bx = carve(&l, 8 * blocks);
    l.ba = carve(&l, 8 * blocks);
    l.bn = carve(&l, 8 * 5 * blocks);
    l.X = carve(&l, 64 * N * moving);
    l.SUM = carve(&l, 64 * N * moving);
    l.K = carve(&l, 64 * N * LENGTHS * w);
    l.BX = carve(&l, 64 * N * blocks);
    l.BA = carve(&l, 64 * N * blocks);
    l.BN = carve(&l, 64 * N * 5 * blocks);
    l.clock = carve(&l, 64 * N);
    l.instant = carve(&l, 8 * (4 + p->channels));
    l.several = carve(&l, 8 * 4 * SEVERAL);
    l.read = carve(&l, STRIDE(N) * SEVERAL);
    return l;
}

static void *make(const po_plan *const p, po_memory *const m, const long N, const int64_t more)
{
    const po_layout l = layout(p, N);
    void *const all = malloc(l.bytes + more + 64);
    if (!all) return NULL;
    memset(all, 0, l.bytes + 64);
    char *const b = (char *)(((uintptr_t)all + 63) / 64 * 64);
    *m = (po_memory){
        b + l.b, (int *)(b + l.at), (double *)(b + l.k), (double *)(b + l.x),
        (double *)(b + l.sum), (double *)(b + l.kept), (double *)(b + l.bx), (double *)(b + l.ba),
        (double *)(b + l.bn), (double *)(b + l.instant), (double *)(b + l.several),
        (double *)(b + l.read), (po_row *)(b + l.X),
        (po_row *)(b + l.SUM), (po_row *)(b + l.K), (po_row *)(b + l.BX), (po_row *)(b + l.BA),
        (po_row *)(b + l.BN), (po_row *)(b + l.clock),
    };
    for (int64_t i = 0; i < p->n_slots; ++i) m->at[i] = p->slots[i] * STRIDE(N);
    return all;
}

INLINE double *number(const po_memory *const m, const int64_t slot, const long N)
{
    return (double *)(m->b + STRIDE(N) * slot);
}

INLINE po_row *rows(const po_memory *const m, const int64_t slot, const long N)
{
    return (po_row *)(m->b + STRIDE(N) * slot + 64);
}

INLINE void evaluate(const po_plan *const p, const po_memory *const m, const po_list list,
                     const long N)
{
    const po_operation *const end = p->operations + list.first + list.count;
    for (const po_operation *o = p->operations + list.first; o < end; ++o)
        if (N) o->moved(m->at + o->at, m->b, m->k + o->kept_moved, N);
        else o->plain(m->at + o->at, m->b, m->k + o->kept_plain, 0);
}

static void prepare(const po_plan *const p, const po_memory *const m, const po_list list,
                    const long N)
{
    const po_operation *const end = p->operations + list.first + list.count;
    for (const po_operation *o = p->operations + list.first; o < end; ++o)
        if (N) o->prepare_moved(m->at + o->at, m->b, m->k + o->kept_moved);
        else o->prepare_plain(m->at + o->at, m->b, m->k + o->kept_plain);
}

/* Parameters, constants and directions. MOVES: for each of D directions the slot whose row has a
   one there, or -1. */
static void begin(const po_plan *const p, const po_memory *const m, const double *const P,
                  const int *const MOVES, const long D, const long N)
{
    for (int64_t i = 0; i < p->n_constants; ++i) *number(m, p->constants[i], N) = p->constant[i];
    for (int64_t i = 0; i < p->parameters; ++i) *number(m, p->parameter + i, N) = P[i];
    for (long d = 0; d < D; ++d)
        if (MOVES[d] >= 0) ((double *)rows(m, MOVES[d], N))[d] = 1.0;
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
    void *const all = make(p, m, N, 0);
    if (!all) return 1;
    begin(p, m, P, MOVES, D, N);
    *number(m, p->time, N) = *T;
    *number(m, p->drive, N) = *U;
    for (int64_t i = 0; i < p->channels; ++i) *number(m, p->channel + i, N) = C[i];
    for (int64_t i = 0; i < p->states; ++i) *number(m, p->deviation + i, N) = DX[i];
    prepare(p, m, p->start, N);
    evaluate(p, m, p->start, N);
    for (int64_t i = 0; i < p->states; ++i) {
        X[i] = *number(m, p->state + i, N);
        if (D) memcpy(S + i * D, rows(m, p->state + i, N), D * sizeof(double));
    }
    free(all);
    return 0;
}

/* The matrix L of the blocks (row-major), and the slopes A of what is left of the rates by the
   states, at each of some instants: time, drive, its slope, channels, their slopes, states. */
int po_slopes(const po_plan *const p, const long instants, const double *AT, const double *P,
              double *L, double *A)
{
    PO_FLUSH
    const long n = p->states, N = instants ? (n + 7) / 8 : 0;
    po_memory memory, *const m = &memory;
    void *const all = make(p, m, N, 0);
    if (!all) return 1;
    begin(p, m, P, NULL, 0, N);
    memset(L, 0, sizeof(double) * n * n);
    prepare(p, m, p->once, N);
    evaluate(p, m, p->once, N);
    for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b)
        for (int i = 0; i < b->size; ++i)
            for (int j = 0; j < b->size; ++j)
                L[(b->state[i] - p->state) * n + b->state[j] - p->state] =
                    *number(m, b->matrix[b->size * i + j], N);
    for (long i = 0; i < n && N; ++i) ((double *)rows(m, p->state + i, N))[i] = 1.0;
    if (N) prepare(p, m, p->driven, N);
    if (N) prepare(p, m, p->stage, N);
    for (long k = 0; k < instants; ++k, A += n * n) {
        *number(m, p->time, N) = *AT++;
        *number(m, p->drive, N) = *AT++;
        *number(m, p->slope, N) = *AT++;
        for (int64_t i = 0; i < p->channels; ++i) *number(m, p->channel + i, N) = *AT++;
        for (int64_t i = 0; i < p->channels; ++i) *number(m, p->channel_slope + i, N) = *AT++;
        for (long i = 0; i < n; ++i) *number(m, p->state + i, N) = *AT++;
        evaluate(p, m, p->driven, N);
        evaluate(p, m, p->stage, N);
        memset(A, 0, sizeof(double) * n * n);
        for (int64_t i = 0; i < p->n_moving; ++i)
            memcpy(A + (p->moving[i] - p->state) * n, rows(m, p->rates[i], N), n * sizeof(double));
        for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b)
            for (int i = 0; i < b->size; ++i) {
                const long at = b->state[i] - p->state;
                if (b->quiet[i]) continue;
                memcpy(A + at * n, rows(m, b->rate[i], N), n * sizeof(double));
                for (long j = 0; b->whole && j < n; ++j) A[at * n + j] -= L[at * n + j];
            }
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
    const po_code *code;
    const double *AT;
    const int *BEGINS;
} po_wanted;

/* Where the instant's own numbers are, a share of a sub-step after its beginning. */
typedef struct { double t, u, du, tT, uT; const double *c, *dc, *cT; } po_instant;

INLINE void place(const po_plan *const p, const po_memory *const m, const po_instant *const at,
                  const double past, const double pastT, const int delayed, const long N)
{
    *number(m, p->time, N) = at->t + past;
    *number(m, p->drive, N) = at->u + at->du * past;
    for (int64_t i = 0; i < p->channels; ++i)
        *number(m, p->channel + i, N) = at->c[i] + at->dc[i] * past;
    if (delayed) ROWS {
        rows(m, p->time, N)[g] = (at->tT + pastT) * m->clock[g];
        rows(m, p->drive, N)[g] = (at->uT + at->du * pastT) * m->clock[g];
        for (int64_t i = 0; i < p->channels; ++i)
            rows(m, p->channel + i, N)[g] = (at->cT[i] + at->dc[i] * pastT) * m->clock[g];
    }
}

/* For entry e of block b: sum over its states of the weights of one kind times numbers, and rows. */
INLINE void weighed(const po_block *const b, const double *const W, const po_row *const WR,
                    const int which, const int e, const double *const of, const po_row *const OF,
                    const int skip_quiet, double *const sum, po_row *all, const long N)
{
    const int64_t size = b->size, first = b->weights + which * size * size + size * e;
    for (int j = 0; j < size; ++j) {
        if (skip_quiet && b->quiet[j]) continue;
        const double w = W[first + j], x = of[j];
        *sum += w * x;
        ROWS all[g] += w * OF[N * j + g] + x * WR[N * (first + j) + g];
    }
}

/* The blocks' rates at stage s, less what their matrix takes over; before any state is moved. */
INLINE void block_rates(const po_plan *const p, const po_memory *const m, const int s,
                        const long N)
{
    const po_block *b = p->blocks;
    for (int64_t k = 0; k < p->n_blocks; ++k, ++b) {
        double *const n = m->bn + (5 * k + s) * 2;
        po_row *const R = m->BN + N * (5 * k + s) * 2;
        for (int i = 0; i < b->size; ++i) {
            if (b->quiet[i]) continue;
            n[i] = *number(m, b->rate[i], N);
            const po_row *const rate = rows(m, b->rate[i], N);
            ROWS R[N * i + g] = rate[g];
            for (int j = 0; b->whole && j < b->size; ++j) {
                const int64_t l = b->matrix[b->size * i + j];
                const double by = *number(m, l, N), of = *number(m, b->state[j], N);
                n[i] -= by * of;
                const po_row *const x = rows(m, b->state[j], N), *const by_row = rows(m, l, N);
                ROWS R[N * i + g] -= by * x[g] + of * by_row[g];
            }
        }
        if (s == 0) for (int i = 0; i < b->size; ++i) {
            m->bx[2 * k + i] = *number(m, b->state[i], N);
            ROWS m->BX[N * (2 * k + i) + g] = rows(m, b->state[i], N)[g];
        }
    }
}

/* The blocks' states at stage s + 1: half-steps from the beginning, the last one from the first
   one's end along 2 n3 - n1. */
INLINE void block_stages(const po_plan *const p, const po_memory *const m, const double *const W,
                         const po_row *const WR, const int s, const long N)
{
    const po_block *b = p->blocks;
    for (int64_t k = 0; k < p->n_blocks; ++k, ++b) {
        if (!b->followed) continue;
        double *along = m->bn + (5 * k + s) * 2, *from = m->bx + 2 * k;
        po_row *ALONG = m->BN + N * (5 * k + s) * 2, *FROM = m->BX + N * 2 * k;
        if (s == 2) {
            double *const n1 = m->bn + 10 * k, *const input = n1 + 8;
            po_row *const R1 = m->BN + N * 10 * k, *const INPUT = R1 + N * 8;
            for (int j = 0; j < b->size; ++j) {
                input[j] = 2.0 * along[j] - n1[j];
                ROWS INPUT[N * j + g] = 2.0 * ALONG[N * j + g] - R1[N * j + g];
            }
            along = input, ALONG = INPUT, from = m->ba + 2 * k, FROM = m->BA + N * 2 * k;
        }
        for (int e = 0; e < b->size; ++e) {
            double sum = 0.0;
            po_row all[N + 1];
            ROWS all[g] = (po_row){0};
            weighed(b, W, WR, HALF, e, from, FROM, 0, &sum, all, N);
            weighed(b, W, WR, HALF_INPUT, e, along, ALONG, 1, &sum, all, N);
            *number(m, b->state[e], N) = sum;
            po_row *const to = rows(m, b->state[e], N);
            ROWS to[g] = all[g];
            if (s == 0) {
                m->ba[2 * k + e] = sum;
                ROWS m->BA[N * (2 * k + e) + g] = all[g];
            }
        }
    }
}

/* The blocks' states at the sub-step's end. */
INLINE void block_ends(const po_plan *const p, const po_memory *const m, const double *const W,
                       const po_row *const WR, const long N)
{
    const po_block *b = p->blocks;
    for (int64_t k = 0; k < p->n_blocks; ++k, ++b) {
        double *const n1 = m->bn + 10 * k, *const n2 = n1 + 2, *const n3 = n1 + 4;
        double *const n4 = n1 + 6, *const input = n1 + 8;
        po_row *const R1 = m->BN + N * 10 * k, *const R2 = R1 + N * 2, *const R3 = R1 + N * 4;
        po_row *const R4 = R1 + N * 6, *const INPUT = R1 + N * 8;
        for (int j = 0; j < b->size; ++j) {
            input[j] = n2[j] + n3[j];
            ROWS INPUT[N * j + g] = R2[N * j + g] + R3[N * j + g];
        }
        for (int e = 0; e < b->size; ++e) {
            double sum = 0.0;
            po_row all[N + 1];
            ROWS all[g] = (po_row){0};
            weighed(b, W, WR, WHOLE, e, m->bx + 2 * k, m->BX + N * 2 * k, 0, &sum, all, N);
            weighed(b, W, WR, FIRST, e, n1, R1, 1, &sum, all, N);
            weighed(b, W, WR, MIDDLE, e, input, INPUT, 1, &sum, all, N);
            weighed(b, W, WR, LAST, e, n4, R4, 1, &sum, all, N);
            *number(m, b->state[e], N) = sum;
            po_row *const to = rows(m, b->state[e], N);
            ROWS to[g] = all[g];
        }
    }
}

/* Moves the states of no block after stage s. They are in an order in which no state is moved that
   is still read as the rate of another one. */
INLINE void move(const po_plan *const p, const po_memory *const m, const int s, const double h,
                 const double hT, const int delayed, const long N)
{
    const double part = s < 2 ? 0.5 * h : s == 2 ? h : h * (1.0 / 6.0);
    const double partT = s < 2 ? 0.5 * hT : s == 2 ? hT : hT * (1.0 / 6.0);
    for (int64_t a = 0; a < p->n_moving; ++a) {
        double *const x = number(m, p->moving[a], N), n = *number(m, p->rates[a], N);
        po_row *const X = rows(m, p->moving[a], N), *const BEGUN = m->X + N * a;
        po_row *const SUM = m->SUM + N * a, *const R = rows(m, p->rates[a], N);
        double way = n;
        if (s == 0) {
            m->x[a] = *x;
            m->sum[a] = n;
            *x += part * n;
            ROWS {
                BEGUN[g] = X[g];
                SUM[g] = R[g];
                X[g] += part * R[g];
            }
        } else if (s < 3) {
            m->sum[a] += 2.0 * n;
            *x = m->x[a] + part * n;
            ROWS {
                SUM[g] += 2.0 * R[g];
                X[g] = BEGUN[g] + part * R[g];
            }
        } else {
            way = m->sum[a] + n;
            *x = m->x[a] + part * way;
            ROWS X[g] = BEGUN[g] + part * (SUM[g] + R[g]);
        }
        if (delayed) ROWS X[g] += (way * partT) * m->clock[g];
    }
}

/* Where machine code finds what the slots do not hold: the length of the sub-step, and derivatives by
   the delay of that, of time, drive and channels; time, drive, slope and length of several samples
   and where their readings go; which groups of directions move the clock. */
typedef struct { int64_t h, hT, late, clock, several, read; uint64_t clocks; } po_instant_places;

#include "machine.h"

/* D numbers of a row. */
INLINE void copied(double *const to, const po_row *const from, const long D)
{
    typedef double four __attribute__((vector_size(32), aligned(8)));
    long d = 0;
    for (; d + 4 <= D; d += 4) *(four *)(to + d) = *(const four *)((const double *)from + d);
    for (; d < D; ++d) to[d] = ((const double *)from)[d];
}

/* The weights of the blocks for a length of a sub-step. */
typedef struct { double *W; po_row *WR; int known, next; } po_lengths;

static void weigh(const po_plan *const p, const po_memory *const m, po_lengths *const l,
                  const double h, const double hT, const long N)
{
    const int64_t nw = p->n_weights, wide = nw + 2;
    int at;
    if (l->known && l->W[nw] == h && l->W[nw + 1] == hT) return;
    for (at = 0; at < l->known; ++at) {
        const double *const one = m->kept + at * wide;
        if (one[nw] == h && one[nw + 1] == hT) break;
    }
    const int fresh = at == l->known;
    if (fresh) {
        if (l->known < LENGTHS) ++l->known;
        else at = l->next;
        l->next = (l->next + 1) % LENGTHS;
    }
    l->W = m->kept + at * wide;
    l->WR = m->K + N * at * wide;
    if (!fresh) return;
    *number(m, p->length, N) = h;
    ROWS rows(m, p->length, N)[g] = hT * m->clock[g];
    evaluate(p, m, p->weigh, N);
    for (int64_t i = 0; i < nw; ++i) {
        l->W[i] = *number(m, p->weights + i, N);
        ROWS l->WR[N * i + g] = rows(m, p->weights + i, N)[g];
    }
    l->W[nw] = h;
    l->W[nw + 1] = hT;
}

/* Keeps reading k, the derivatives of which lie a line behind it; whether that takes the sum of squares
   above the most that is wanted. */
INLINE int taken(const po_plan *const p, const po_memory *const m, const po_wanted *const to,
                 const long k, const double *const read, double *const squares, const long N)
{
    const double y = to->Y[k] = *read;
    if (N) copied(to->J + k * to->D, (const po_row *)(read + 8), to->D);
    if (to->XO)
        for (int64_t a = 0; a < p->states; ++a)
            to->XO[k * p->states + a] = *number(m, p->state + a, N);
    if (!to->M || to->M[k] != to->M[k]) return 0;
    *squares += (y - to->M[k]) * (y - to->M[k]);
    return !(*squares <= to->most);
}

/* What is read may be a state as it stands. */
INLINE int reads(const po_plan *const p)
{
    return p->reading.count || p->read < p->state || p->read >= p->state + p->states;
}

static void prepare_all(const po_plan *const p, const po_memory *const m, const long N)
{
    prepare(p, m, p->once, N);
    evaluate(p, m, p->once, N);
    prepare(p, m, p->weigh, N);
    prepare(p, m, p->driven, N);
    prepare(p, m, p->stage, N);
    prepare(p, m, p->reading, N);
    prepare(p, m, p->jump, N);
}

/* Where a segment begins. */
INLINE po_instant instant_of(const po_plan *const p, const po_segments *const s, const long j,
                             double *const c, double *const cT, const int delayed)
{
    const int64_t nc = p->channels;
    po_instant i = {s->T[j], s->U[j], s->DU[j], 0.0, 0.0, c, s->DC + j * nc, cT};
    for (int64_t a = 0; a < nc; ++a) c[a] = s->C[j * nc + a];
    if (delayed) {
        i.tT = s->TT[j];
        i.uT = s->UT[j];
        for (int64_t a = 0; a < nc; ++a) cT[a] = s->CT[j * nc + a];
    }
    return i;
}

INLINE void advance(const po_plan *const p, po_instant *const i, double *const c, double *const cT,
                    const double h, const double hT, const int delayed)
{
    i->t += h;
    i->u += i->du * h;
    for (int64_t a = 0; a < p->channels; ++a) c[a] += i->dc[a] * h;
    if (!delayed) return;
    i->tT += hT;
    i->uT += i->du * hT;
    for (int64_t a = 0; a < p->channels; ++a) cT[a] += i->dc[a] * hT;
}

/* What is driven, where the first segment begins. From then on it is known wherever a sub-step
   begins and a reading is taken: as it was where the last sub-step ended. */
INLINE void drive_begins(const po_plan *const p, const po_memory *const m, const long n,
                         const po_segments *const s, double *const c, double *const cT,
                         const int delayed, const long N)
{
    if (!n || !p->driven.count) return;
    const po_instant i = instant_of(p, s, 0, c, cT, delayed);
    place(p, m, &i, 0.0, 0.0, delayed, N);
    evaluate(p, m, p->driven, N);
}

/* Function by function. Returns whether it came to the end. */
INLINE int walk(const po_plan *const p, const po_memory *const m, const long n,
                const po_segments *const s, const po_wanted *const to, const int delayed,
                const long N)
{
    const int64_t nc = p->channels;
    double c[nc + 1], cT[nc + 1], squares = 0.0;
    const double *const read = number(m, p->read, N);
    po_lengths l = {m->kept, m->K, 0, 0};

    prepare_all(p, m, N);
    drive_begins(p, m, n, s, c, cT, delayed, N);
    for (long j = 0; j < n; ++j) {
        const int cuts = s->NSUB[j];
        const double h = cuts > 0 ? s->H[j] / cuts : 0.0;
        const double hT = delayed && cuts > 0 ? s->HT[j] / cuts : 0.0;
        if (p->n_weights) weigh(p, m, &l, h, hT, N);
        po_instant i = instant_of(p, s, j, c, cT, delayed);
        for (int64_t a = 0; a < nc; ++a) *number(m, p->channel_slope + a, N) = i.dc[a];
        *number(m, p->slope, N) = i.du;
        for (int cut = 0; cut < cuts; ++cut) {
#define STAGE(s, past, pastT)                                                                      \
    place(p, m, &i, past, pastT, delayed, N);                                                      \
    if ((s) & 1) evaluate(p, m, p->driven, N);                                                     \
    evaluate(p, m, p->stage, N);                                                                   \
    block_rates(p, m, s, N);                                                                       \
    move(p, m, s, h, hT, delayed, N);
            STAGE(0, 0.0, 0.0)
            block_stages(p, m, l.W, l.WR, 0, N);
            STAGE(1, 0.5 * h, 0.5 * hT)
            block_stages(p, m, l.W, l.WR, 1, N);
            STAGE(2, 0.5 * h, 0.5 * hT)
            block_stages(p, m, l.W, l.WR, 2, N);
            STAGE(3, h, hT)
            block_ends(p, m, l.W, l.WR, N);
            if (p->n_jumping) {
                double became[p->n_jumping];
                po_row BECAME[N * p->n_jumping + 1];
                evaluate(p, m, p->jump, N);
                for (int64_t a = 0; a < p->n_jumping; ++a) {
                    became[a] = *number(m, p->after[a], N);
                    ROWS BECAME[N * a + g] = rows(m, p->after[a], N)[g];
                }
                for (int64_t a = 0; a < p->n_jumping; ++a) {
                    *number(m, p->jumping[a], N) = became[a];
                    ROWS rows(m, p->jumping[a], N)[g] = BECAME[N * a + g];
                }
            }
            advance(p, &i, c, cT, h, hT, delayed);
        }
        if (s->OBS[j] < 0) continue;
        place(p, m, &i, 0.0, 0.0, delayed, N);
        if (reads(p)) evaluate(p, m, p->reading, N);
        if (taken(p, m, to, s->OBS[j], read, &squares, N)) return 0;
    }
    return 1;
}

#ifdef PO_MACHINE
/* Numbers of an instant where machine code looks for them. */
INLINE void placed(const po_plan *const p, const po_memory *const m, const po_instant *const i,
                   const int delayed, const long N)
{
    *number(m, p->time, N) = i->t;
    *number(m, p->drive, N) = i->u;
    for (int64_t a = 0; a < p->channels; ++a) *number(m, p->channel + a, N) = i->c[a];
    if (!delayed) return;
    m->instant[2] = i->tT;
    m->instant[3] = i->uT;
    for (int64_t a = 0; a < p->channels; ++a) m->instant[4 + a] = i->cT[a];
}

/* By machine code. Sub-steps wait until there are several, if they may be done at once. */
static int walk_machine(const po_plan *const p, const po_memory *const m, const long n,
                        const po_segments *const s, const po_wanted *const to, const int delayed,
                        const long N)
{
    const po_code *const code = to->code;
    const int64_t nc = p->channels, nw = p->n_weights, wide = STRIDE(N) / 8;
    const int several = code->count > 1 && !to->XO ? (int)code->count : 0, read_too = reads(p);
    const double *const read = number(m, p->read, N);
    double *const slope = number(m, p->slope, N), *const instant = m->instant;
    double c[nc + 1], cT[nc + 1], squares = 0.0, h = 0.0, hT = 0.0, length = -1.0;
    long waits[SEVERAL];
    int waiting = 0, cut_before = -1;
    po_lengths l = {m->kept, m->K, 0, 0};

    prepare_all(p, m, N);
    drive_begins(p, m, n, s, c, cT, delayed, N);
    for (long j = 0; j <= n; ++j) {
        if (several && !waiting && j + several <= n) { /* the usual: a sub-step a sample */
            int usual = 1;
            for (int a = 0; a < several; ++a)
                usual &= s->NSUB[j + a] == 1
                    && (!nw || (s->H[j + a] == length && cut_before == 1));
            if (usual) {
                for (int a = 0; a < several; ++a) {
                    double *const one = m->several + 4 * a;
                    one[0] = s->T[j + a], one[1] = s->U[j + a], one[2] = s->DU[j + a];
                    one[3] = s->H[j + a];
                }
                code->several(m->b, l.W, l.WR);
                for (int a = 0; a < several; ++a)
                    if (s->OBS[j + a] >= 0
                        && taken(p, m, to, s->OBS[j + a], m->read + a * wide, &squares, N))
                        return 0;
                j += several - 1;
                continue;
            }
        }
        const int cuts = j < n ? s->NSUB[j] : 0;
        const int other = j == n || s->H[j] != length || cuts != cut_before;
        if (waiting && (cuts == 0 || (other && nw))) { /* do what waits one by one */
            for (int a = 0; a < waiting; ++a) {
                const double *const one = m->several + 4 * a;
                po_instant i = {one[0], one[1], one[2], 0.0, 0.0, c, NULL, cT};
                placed(p, m, &i, 0, N);
                *slope = i.du;
                instant[0] = one[3];
                code->step(m->b, l.W, l.WR);
                advance(p, &i, c, cT, one[3], 0.0, 0);
                if (waits[a] < 0) continue;
                placed(p, m, &i, 0, N);
                if (read_too) code->reading(m->b, l.W, l.WR);
                if (taken(p, m, to, waits[a], read, &squares, N)) return 0;
            }
            waiting = 0;
        }
        if (j == n) break;
        if (other || delayed) {
            length = s->H[j];
            cut_before = cuts;
            h = cuts > 0 ? length / cuts : 0.0;
            hT = delayed && cuts > 0 ? s->HT[j] / cuts : 0.0;
            if (nw) weigh(p, m, &l, h, hT, N);
        }
        if (several && cuts > 0) {
            const double du = s->DU[j];
            double t = s->T[j], u = s->U[j];
            for (int cut = 0; cut < cuts; ++cut) {
                double *const one = m->several + 4 * waiting;
                one[0] = t, one[1] = u, one[2] = du, one[3] = h;
                waits[waiting++] = cut == cuts - 1 ? s->OBS[j] : -1;
                t += h;
                u += du * h;
                if (waiting < several) continue;
                code->several(m->b, l.W, l.WR);
                waiting = 0;
                for (int a = 0; a < several; ++a)
                    if (waits[a] >= 0
                        && taken(p, m, to, waits[a], m->read + a * wide, &squares, N)) return 0;
            }
            continue;
        }
        po_instant i = instant_of(p, s, j, c, cT, delayed);
        *slope = i.du;
        instant[0] = h;
        instant[1] = hT;
        for (int64_t a = 0; a < nc; ++a) *number(m, p->channel_slope + a, N) = i.dc[a];
        for (int cut = 0; cut < cuts; ++cut) {
            placed(p, m, &i, delayed, N);
            code->step(m->b, l.W, l.WR);
            advance(p, &i, c, cT, h, hT, delayed);
        }
        if (s->OBS[j] < 0) continue;
        placed(p, m, &i, delayed, N);
        if (read_too) code->reading(m->b, l.W, l.WR);
        if (taken(p, m, to, s->OBS[j], read, &squares, N)) return 0;
    }
    return 1;
}
#endif

/* n segments: length H [s], sub-steps NSUB, start time T, drive U with slope DU, channels C with
   slopes DC (row-major), derivatives by the delay HT, UT, TT, CT; OBS is the index of the reading
   taken at the segment's end, or -1. X and S hold the states and their sensitivities (row-major)
   at the start on entry and at the end on return; Y, J, XO take readings, their sensitivities
   (row-major) and, if XO is not null, the states at the readings. CLOCKS: for each direction
   whether it moves the clock of the whole chain; null where none does. If M is not null the run
   ends, its results unfinished, as soon as the sum of squares of the readings minus M exceeds the
   most or is none; entries of M that are NaN do not count. With AT (time, drive, channels and
   deviation DX at the start) it begins at rest there, X and S need not be set, and BEGINS holds the
   slot that each direction moves at the start. Returns 0; 1 without memory; 2, with X and S set and
   nothing else done, where the code is not for such sensitivities. */
int po_run(const po_plan *const p, const long n, const po_segments *const s,
           const po_wanted *const to)
{
    PO_FLUSH
    const long D = to->D, N = (D + 7) / 8;
    if (to->AT) {
        const double *const C = to->AT + 2, *const DX = C + p->channels;
        if (po_start(p, to->AT, to->AT + 1, C, to->P, DX, to->BEGINS, D, to->X, to->S)) return 1;
        if (to->code && !po_suits(to->code, to->S, D)) return 2;
    }
    po_memory memory, *const m = &memory;
    void *const all = make(p, m, N, to->code ? to->code->spills : 0);
    if (!all) return 1;
    begin(p, m, to->P, to->MOVES, D, N);
    for (int64_t a = 0; a < p->states; ++a) {
        *number(m, p->state + a, N) = to->X[a];
        if (N) memcpy(rows(m, p->state + a, N), to->S + a * D, D * sizeof(double));
    }
    if (to->CLOCKS) for (long d = 0; d < D; ++d) ((double *)m->clock)[d] = to->CLOCKS[d];
    const int delayed = to->CLOCKS && N;
    int ended = 0;
#ifdef PO_MACHINE /* else it is for processors that are too old, and for tests */
    if (to->code) ended = walk_machine(p, m, n, s, to, delayed, N);
#else
    if (N == 0) ended = walk(p, m, n, s, to, 0, 0);
    else if (N == 1 && !delayed) ended = walk(p, m, n, s, to, 0, 1);
    else if (N == 2 && !delayed) ended = walk(p, m, n, s, to, 0, 2);
    else if (N == 3 && !delayed) ended = walk(p, m, n, s, to, 0, 3);
#endif
    else ended = walk(p, m, n, s, to, delayed, N);
    for (int64_t a = 0; ended && a < p->states; ++a) {
        to->X[a] = *number(m, p->state + a, N);
        if (N) memcpy(to->S + a * D, rows(m, p->state + a, N), D * sizeof(double));
    }
    free(all);
    return 0;
}
