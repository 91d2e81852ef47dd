/* The sub-step of a composed model as a list of instructions, made when the model is run first.
 *
 * The words of all operations of the four stages are put one behind the other: what two stages
 * share is computed once, and rows of derivatives are computed in those groups of four directions
 * in which they are not zero. What becomes of the list is in assembler.h.
 *
 * It takes some tens of microseconds. Processors without AVX2 and other systems than those of the
 * System V ABI use the functions themselves, to the same numbers but for rounding.
 */
#include "assembler.h"
#ifdef PO_MACHINE

/* Whether a value is another one with the other sign, and which. */
static int turned(const po_trace *const t, const int k)
{
    return t->list[k].op == M_FLIP ? t->list[k].in[1] : NOTHING;
}

static int minus(po_trace *const t, const int a)
{
    if (turned(t, a) != NOTHING) return turned(t, a);
    if (t->list[a].op == M_CONSTANT) return constant(t, -t->list[a].by.number);
    return said(t, plain(M_FLIP, constant(t, -0.0), a, NOTHING));
}

static int sum(po_trace *const t, const int a, const int b)
{
    if (is(t, a, 0.0)) return b;
    if (is(t, b, 0.0)) return a;
    if (turned(t, b) != NOTHING) return said(t, plain(M_SUB, a, turned(t, b), NOTHING));
    if (turned(t, a) != NOTHING) return said(t, plain(M_SUB, b, turned(t, a), NOTHING));
    return said(t, plain(M_ADD, a < b ? a : b, a < b ? b : a, NOTHING));
}

static int difference(po_trace *const t, const int a, const int b)
{
    if (is(t, b, 0.0)) return a;
    if (is(t, a, 0.0)) return minus(t, b);
    if (turned(t, b) != NOTHING) return sum(t, a, turned(t, b));
    return said(t, plain(M_SUB, a, b, NOTHING));
}

static int product(po_trace *const t, const int a, const int b)
{
    if (is(t, a, 1.0)) return b;
    if (is(t, b, 1.0)) return a;
    if (is(t, a, -1.0)) return minus(t, b);
    if (is(t, b, -1.0)) return minus(t, a);
    if (t->list[a].op == M_CONSTANT && t->list[b].op == M_CONSTANT)
        return constant(t, t->list[a].by.number * t->list[b].by.number);
    return said(t, plain(M_MUL, a < b ? a : b, a < b ? b : a, NOTHING));
}

/* all + by * row, where no row is none. */
static int along(po_trace *const t, const int all, const int by, const int row)
{
    if (row == NOTHING || is(t, by, 0.0)) return all;
    if (all == NOTHING) return product(t, by, row);
    if (is(t, by, 1.0)) return sum(t, all, row);
    if (is(t, by, -1.0)) return difference(t, all, row);
    if (turned(t, by) != NOTHING) return said(t, plain(M_LESS_JOIN, turned(t, by), row, all));
    return said(t, plain(M_JOIN, by, row, all));
}

static int compared(po_trace *const t, const int kind, const int a, const int b)
{
    po_instruction one = plain(M_COMPARE, a, b, NOTHING);
    one.detail = kind;
    return said(t, one);
}

enum { LESS = 0x11, AT_MOST = 0x12, EQUAL = 0x00, UNEQUAL = 0x04, MORE = 0x1e };

/* One where bits are set. */
static int truth(po_trace *const t, const int mask)
{
    return said(t, plain(M_AND, mask, constant(t, 1.0), NOTHING));
}

/* All bits set where a number is not zero. */
static int mask_of(po_trace *const t, const int a)
{
    const po_instruction *const one = t->list + a;
    if (one->op == M_AND && is(t, one->in[1], 1.0)) return one->in[0];
    return compared(t, UNEQUAL, a, constant(t, 0.0));
}

/* One where a number is zero. */
static int untruth(po_trace *const t, const int a)
{
    const po_instruction *const one = t->list + a;
    const int said_so = one->op == M_AND && is(t, one->in[1], 1.0);
    return said_so ? said(t, plain(M_CLEAR, one->in[0], constant(t, 1.0), NOTHING))
                   : truth(t, compared(t, EQUAL, a, constant(t, 0.0)));
}

/* A number where another one is not zero. */
static int where(po_trace *const t, const int a, const int b)
{
    const po_instruction *const one = t->list + a;
    const int no = one->op == M_CLEAR && is(t, one->in[1], 1.0)
        && t->list[one->in[0]].op == M_COMPARE;
    return said(t, no ? plain(M_CLEAR, one->in[0], b, NOTHING)
                       : plain(M_AND, mask_of(t, a), b, NOTHING));
}

/* What the numbers of the instants are while the list is written: of each slot the number and its
   rows, unknown until they are asked for. */
typedef struct {
    po_trace trace;
    const po_plan *plan;
    const uint64_t *groups; /* of each slot: where its rows may be other than zero */
    int *number, *row, many; /* many: groups of four directions */
    int64_t stride, kept;
    int moved;
} po_writer;

static int number_of(po_writer *const w, const int64_t slot)
{
    if (w->number[slot] == UNKNOWN) {
        const po_plan *const p = w->plan;
        for (int64_t i = 0; i < p->n_constants; ++i)
            if (p->constants[i] == slot)
                return w->number[slot] = constant(&w->trace, p->constant[i]);
        w->number[slot] = loaded(&w->trace, M_LOAD, AT_SLOTS, slot * w->stride);
    }
    return w->number[slot];
}

static int row_of(po_writer *const w, const int64_t slot, const int g)
{
    int *const known = w->row + slot * w->many + g;
    if (*known == UNKNOWN)
        *known = w->groups[slot] >> g & 1
            ? loaded(&w->trace, M_ROW, AT_SLOTS, slot * w->stride + 64 + 32 * g) : NOTHING;
    return *known;
}

static void set(po_writer *const w, const int64_t slot, const int number)
{
    w->number[slot] = number;
    for (int g = 0; g < w->many; ++g) w->row[slot * w->many + g] = NOTHING;
}

static int *rows_at(po_writer *const w, const int64_t slot) { return w->row + slot * w->many; }

static po_evaluate *const SUMS[] = {po_sum_1, po_sum_2, po_sum_3, po_sum_4};

/* Number of terms of an operation that is a sum, or 0. */
static int terms_of(const po_operation *const o)
{
    for (int k = 0; k < 4; ++k) if (o->plain == SUMS[k]) return k + 1;
    return 0;
}

static void write_words(po_writer *const w, const po_operation *const o)
{
    po_trace *const t = &w->trace;
    const int *const A = w->plan->slots + o->at;
    const po_word *const words = w->moved ? o->words_moved : o->words_plain;
    const int64_t kept = w->kept + 8 * (w->moved ? o->kept_moved : o->kept_plain);
    const int inputs = (int)o->inputs;
    int count = 0;
    while (words[count].word != PO_END) ++count;
    int *const v = malloc(sizeof(int) * (count + 1));
    if (!v) {
        t->failed = 1;
        return;
    }
    for (int k = 0; k < count; ++k) {
        const po_word *const one = words + k;
        const int a = one->word > PO_KEPT && one->word < PO_END ? v[one->a] : 0;
        const int b = one->word >= PO_ADD && one->word < PO_END && one->b <= k ? v[one->b] : 0;
        po_instruction call = plain(M_CALL, a, NOTHING, NOTHING);
        call.by.called = one->called;
        call.detail = one->word == PO_CALL ? one->b : 0;
        switch (one->word) {
        case PO_CONSTANT: v[k] = constant(t, one->number); break;
        case PO_READ: v[k] = number_of(w, A[one->a]); break;
        case PO_KEPT: v[k] = loaded(t, M_LOAD, AT_SLOTS, kept + 8 * one->a); break;
        case PO_SAME: v[k] = a; break;
        case PO_ADD: v[k] = sum(t, a, b); break;
        case PO_SUB: v[k] = difference(t, a, b); break;
        case PO_MUL: v[k] = product(t, a, b); break;
        case PO_DIV: v[k] = said(t, plain(M_DIV, a, b, NOTHING)); break;
        case PO_MIN: v[k] = said(t, plain(M_MIN, a, b, NOTHING)); break;
        case PO_MAX: v[k] = said(t, plain(M_MAX, a, b, NOTHING)); break;
        case PO_LESS: v[k] = truth(t, compared(t, LESS, a, b)); break;
        case PO_AT_MOST: v[k] = truth(t, compared(t, AT_MOST, a, b)); break;
        case PO_EQUAL: v[k] = truth(t, compared(t, EQUAL, a, b)); break;
        case PO_UNEQUAL: v[k] = truth(t, compared(t, UNEQUAL, a, b)); break;
        case PO_AND:
            v[k] = said(t, plain(M_AND, mask_of(t, a), truth(t, mask_of(t, b)), NOTHING));
            break;
        case PO_OR:
            v[k] = sum(t, truth(t, mask_of(t, a)),
                       said(t, plain(M_CLEAR, mask_of(t, a), truth(t, mask_of(t, b)), NOTHING)));
            break;
        case PO_NOT: v[k] = untruth(t, a); break;
        case PO_WHERE: v[k] = where(t, a, b); break;
        case PO_MINUS: v[k] = minus(t, a); break;
        case PO_SQUARE: v[k] = product(t, a, a); break;
        case PO_TWICE: v[k] = said(t, plain(M_ADD, a, a, NOTHING)); break;
        case PO_INVERSE: v[k] = said(t, plain(M_DIV, constant(t, 1.0), a, NOTHING)); break;
        case PO_ROOT: v[k] = said(t, plain(M_ROOT, a, NOTHING, NOTHING)); break;
        case PO_SIZE: v[k] = said(t, plain(M_CLEAR, constant(t, -0.0), a, NOTHING)); break;
        case PO_SIGN: {
            const int zero = constant(t, 0.0);
            v[k] = difference(t, truth(t, compared(t, MORE, a, zero)),
                              truth(t, compared(t, LESS, a, zero)));
            break;
        }
        case PO_POWER:
            call.op = M_POWER;
            call.place = (int)(kept + 8 * one->b);
            v[k] = said(t, call);
            break;
        case PO_CALL: v[k] = said(t, call); break;
        case PO_CALL_TWO: call.in[1] = b; v[k] = said(t, call); break;
        case PO_OUTPUT: v[k] = a; break;
        case PO_SLOPE: v[k] = a; break;
        }
    }
    for (int k = 0; k < count; ++k)
        if (words[k].word == PO_OUTPUT) set(w, A[inputs + words[k].b], v[k]);
    for (int k = 0; k < count; ++k) {
        if (words[k].word != PO_SLOPE) continue;
        const int64_t out = A[inputs + (int)words[k].number];
        for (int g = 0; g < w->many; ++g)
            rows_at(w, out)[g] = along(t, rows_at(w, out)[g], v[k], row_of(w, A[words[k].b], g));
    }
    free(v);
}

static void write_list(po_writer *const w, const po_list list)
{
    const po_plan *const p = w->plan;
    po_trace *const t = &w->trace;
    for (const po_operation *o = p->operations + list.first, *end = o + list.count; o < end; ++o) {
        const int *const A = p->slots + o->at;
        const int terms = terms_of(o);
        if (terms) {
            int all = constant(t, 0.0), by[4];
            for (int k = 0; k < terms; ++k) {
                by[k] = number_of(w, A[2 * k + 2]);
                all = sum(t, all, product(t, by[k], number_of(w, A[2 * k + 1])));
            }
            set(w, A[0], all);
            for (int g = 0; g < w->many; ++g)
                for (int k = 0; k < terms; ++k)
                    rows_at(w, A[0])[g] =
                        along(t, rows_at(w, A[0])[g], by[k], row_of(w, A[2 * k + 1], g));
        } else if (o->plain == po_product) {
            const int a = number_of(w, A[0]), b = number_of(w, A[1]);
            set(w, A[2], product(t, a, b));
            for (int g = 0; g < w->many; ++g)
                rows_at(w, A[2])[g] = along(
                    t, along(t, NOTHING, b, row_of(w, A[0], g)), a, row_of(w, A[1], g));
        } else if (o->plain == po_quotient) {
            const int by = said(t, plain(M_DIV, constant(t, 1.0), number_of(w, A[1]), NOTHING));
            const int q = product(t, number_of(w, A[0]), by), less = minus(t, product(t, q, by));
            set(w, A[2], q);
            for (int g = 0; g < w->many; ++g)
                rows_at(w, A[2])[g] = along(
                    t, along(t, NOTHING, by, row_of(w, A[0], g)), less, row_of(w, A[1], g));
        } else if (o->words_plain) write_words(w, o);
        else t->failed = 1;
    }
}

/* The length of the sub-step, which of several. */
static int length_of(po_writer *const w, const po_instant_places *const at, const int which)
{
    const int64_t place = which < 0 ? at->h : at->several + 8 * (4 * which + 3);
    return loaded(&w->trace, M_LOAD, AT_SLOTS, place);
}

/* Time, drive and channels a share of a sub-step after its beginning; which of several, or -1. */
static void write_instant(po_writer *const w, const po_instant_places *const at, const double share,
                          const int which)
{
    po_trace *const t = &w->trace;
    const po_plan *const p = w->plan;
    const int part = constant(t, share);
    const int past = share ? product(t, part, length_of(w, at, which)) : part;
    const int late = share ? product(t, part, loaded(t, M_LOAD, AT_SLOTS, at->hT)) : part;
    for (int64_t i = -2; i < p->channels; ++i) {
        const int64_t slot = i == -2 ? p->time : i == -1 ? p->drive : p->channel + i;
        const int64_t by = i == -1 ? p->slope : p->channel_slope + i;
        const int64_t place = which < 0 ? slot * w->stride : at->several + 8 * (4 * which + i + 2);
        const int begun = loaded(t, M_LOAD, AT_SLOTS, place);
        const int slope = i == -2 ? constant(t, 1.0) : number_of(w, by);
        set(w, slot, share ? sum(t, begun, product(t, slope, past)) : begun);
        for (int g = 0; g < w->many; ++g) {
            if (!(at->clocks >> g & 1)) continue;
            const int lag = loaded(t, M_LOAD, AT_SLOTS, at->late + 8 * (i + 2));
            const int clock = loaded(t, M_ROW, AT_SLOTS, at->clock + 32 * g);
            const int by = share ? sum(t, lag, product(t, slope, late)) : lag;
            rows_at(w, slot)[g] = product(t, by, clock);
        }
    }
}

/* A value and its rows apart from any slot. */
typedef struct { int number, row[64]; } po_value;

static po_value value_of(po_writer *const w, const int64_t slot)
{
    po_value found = {number_of(w, slot), {0}};
    for (int g = 0; g < w->many; ++g) found.row[g] = row_of(w, slot, g);
    return found;
}

static po_value no_value(po_writer *const w)
{
    po_value found = {constant(&w->trace, 0.0), {0}};
    for (int g = 0; g < w->many; ++g) found.row[g] = NOTHING;
    return found;
}

static void put(po_writer *const w, const int64_t slot, const po_value *const of)
{
    w->number[slot] = of->number;
    for (int g = 0; g < w->many; ++g) rows_at(w, slot)[g] = of->row[g];
}

/* to + by * of, by a number that no direction moves. */
static po_value added(po_writer *const w, const po_value *const to, const int by,
                      const po_value *const of)
{
    po_value found;
    found.number = sum(&w->trace, to->number, product(&w->trace, by, of->number));
    for (int g = 0; g < w->many; ++g) found.row[g] = along(&w->trace, to->row[g], by, of->row[g]);
    return found;
}

/* to + a b. */
static void add_product(po_writer *const w, po_value *const to, const po_value *const a,
                        const po_value *const b, const double sign)
{
    po_trace *const t = &w->trace;
    const int by_a = sign < 0 ? minus(t, a->number) : a->number;
    const int by_b = sign < 0 ? minus(t, b->number) : b->number;
    to->number = sum(t, to->number, product(t, by_a, b->number));
    for (int g = 0; g < w->many; ++g)
        to->row[g] = along(t, along(t, to->row[g], by_a, b->row[g]), by_b, a->row[g]);
}

static po_value weight_of(po_writer *const w, const int64_t k)
{
    po_value found = {loaded(&w->trace, M_LOAD, AT_WEIGHTS, 8 * k), {0}};
    for (int g = 0; g < w->many; ++g)
        found.row[g] = w->groups[w->plan->weights + k] >> g & 1
            ? loaded(&w->trace, M_ROW, AT_WEIGHT_ROWS, 64 * k * ((w->many + 1) / 2) + 32 * g)
            : NOTHING;
    return found;
}

static void add_weighed(po_writer *const w, po_value *const to, const po_block *const b,
                        const int which, const int e, const po_value *const of, const int skip)
{
    const int64_t first = b->weights + which * b->size * b->size + b->size * e;
    for (int j = 0; j < b->size; ++j) {
        if (skip && b->quiet[j]) continue;
        const po_value by = weight_of(w, first + j);
        add_product(w, to, &by, of + j, 1.0);
    }
}

static void store_at(po_writer *const w, const int64_t slot, const int64_t place)
{
    po_trace *const t = &w->trace;
    po_instruction one = plain(M_STORE, number_of(w, slot), NOTHING, NOTHING);
    one.detail = AT_SLOTS;
    one.place = (int)place;
    const po_instruction *const from = t->list + one.in[0];
    if (from->op != M_LOAD || from->detail != AT_SLOTS || from->place != one.place) said(t, one);
    for (int g = 0; g < w->many; ++g) {
        if (!(w->groups[slot] >> g & 1)) continue;
        const int row = row_of(w, slot, g);
        one = plain(M_STORE_ROW, row == NOTHING ? constant(t, 0.0) : row, NOTHING, NOTHING);
        one.detail = AT_SLOTS;
        one.place = (int)(place + 64 + 32 * g);
        const po_instruction *const old = t->list + one.in[0];
        if (old->op != M_ROW || old->detail != AT_SLOTS || old->place != one.place) said(t, one);
    }
}

static void store(po_writer *const w, const int64_t slot)
{
    store_at(w, slot, slot * w->stride);
}

typedef struct { po_value begun[2], first[2], rate[4][2]; } po_block_values;

static void write_blocks(po_writer *const w, po_block_values *const all, const int s)
{
    const po_plan *const p = w->plan;
    const int less = constant(&w->trace, -1.0), one = constant(&w->trace, 1.0);
    const int two = constant(&w->trace, 2.0);
    const po_value none = no_value(w);
    for (int64_t k = 0; k < p->n_blocks; ++k) {
        const po_block *const b = p->blocks + k;
        po_block_values *const v = all + k;
        po_value next[2];
        if (s < 3 && !b->followed) continue;
        for (int e = 0; e < b->size; ++e) {
            po_value *const to = next + e;
            *to = none;
            if (s < 2) {
                add_weighed(w, to, b, HALF, e, v->begun, 0);
                add_weighed(w, to, b, HALF_INPUT, e, v->rate[s], 1);
            } else if (s == 2) {
                po_value input[2];
                for (int j = 0; j < b->size; ++j) {
                    if (b->quiet[j]) continue;
                    const po_value twice = added(w, &none, two, &v->rate[2][j]);
                    input[j] = added(w, &twice, less, &v->rate[0][j]);
                }
                add_weighed(w, to, b, HALF, e, v->first, 0);
                add_weighed(w, to, b, HALF_INPUT, e, input, 1);
            } else {
                po_value input[2];
                for (int j = 0; j < b->size; ++j)
                    if (!b->quiet[j]) input[j] = added(w, &v->rate[1][j], one, &v->rate[2][j]);
                add_weighed(w, to, b, WHOLE, e, v->begun, 0);
                add_weighed(w, to, b, FIRST, e, v->rate[0], 1);
                add_weighed(w, to, b, MIDDLE, e, input, 1);
                add_weighed(w, to, b, LAST, e, v->rate[3], 1);
            }
        }
        for (int e = 0; e < b->size; ++e) {
            if (s == 0) v->first[e] = next[e];
            put(w, b->state[e], next + e);
        }
    }
}

static void write_step(po_writer *const w, const po_instant_places *const at, const int which)
{
    po_trace *const t = &w->trace;
    const po_plan *const p = w->plan;
    const double shares[] = {0.0, 0.5, 0.5, 1.0}, parts[] = {0.5, 0.5, 1.0, 1.0 / 6.0};
    const int64_t n = p->n_moving;
    po_value *const begun = malloc(sizeof(po_value) * (2 * n + 1)), *const all = begun + n;
    po_value *const rate = malloc(sizeof(po_value) * (n + 1));
    po_block_values *const blocks = malloc(sizeof(po_block_values) * (p->n_blocks + 1));
    if (!begun || !rate || !blocks) t->failed = 1;
    for (int s = 0; s < 4 && !t->failed; ++s) {
        write_instant(w, at, shares[s], which);
        if (s & 1) write_list(w, p->driven);
        write_list(w, p->stage);
        for (int64_t k = 0; k < p->n_blocks; ++k) {
            const po_block *const b = p->blocks + k;
            for (int i = 0; i < b->size; ++i) {
                if (s == 0) blocks[k].begun[i] = value_of(w, b->state[i]);
                if (b->quiet[i]) continue;
                po_value found = value_of(w, b->rate[i]);
                for (int j = 0; b->whole && j < b->size; ++j) {
                    const po_value by = value_of(w, b->matrix[b->size * i + j]);
                    const po_value of = value_of(w, b->state[j]);
                    add_product(w, &found, &by, &of, -1.0);
                }
                blocks[k].rate[s][i] = found;
            }
        }
        const int part = product(t, constant(t, parts[s]), length_of(w, at, which));
        const int late = product(t, constant(t, parts[s]), loaded(t, M_LOAD, AT_SLOTS, at->hT));
        for (int64_t a = 0; a < n; ++a) rate[a] = value_of(w, p->rates[a]);
        for (int64_t a = 0; a < n; ++a) {
            po_value way = rate[a];
            if (s == 0) {
                begun[a] = value_of(w, p->moving[a]);
                all[a] = way;
            } else if (s < 3) all[a] = added(w, all + a, constant(t, 2.0), &way);
            else way = added(w, all + a, constant(t, 1.0), &way);
            po_value next = added(w, begun + a, part, &way);
            for (int g = 0; g < w->many; ++g)
                if (at->clocks >> g & 1)
                    next.row[g] = along(t, next.row[g], product(t, way.number, late),
                                        loaded(t, M_ROW, AT_SLOTS, at->clock + 32 * g));
            put(w, p->moving[a], &next);
            if (s == 3 && !p->n_jumping && which < 0) store(w, p->moving[a]);
        }
        write_blocks(w, blocks, s);
    }
    if (p->n_jumping && !t->failed) {
        write_list(w, p->jump);
        po_value *const became = malloc(sizeof(po_value) * p->n_jumping);
        if (!became) t->failed = 1;
        for (int64_t a = 0; became && a < p->n_jumping; ++a) became[a] = value_of(w, p->after[a]);
        for (int64_t a = 0; became && a < p->n_jumping; ++a) put(w, p->jumping[a], became + a);
        free(became);
    }
    if (which < 0 && p->n_jumping)
        for (int64_t a = 0; a < p->states && !t->failed; ++a) store(w, p->state + a);
    else if (which < 0)
        for (int64_t k = 0; k < p->n_blocks && !t->failed; ++k)
            for (int i = 0; i < p->blocks[k].size; ++i) store(w, p->blocks[k].state[i]);
    for (int64_t a = 0; which < 0 && a < p->n_ends && !t->failed; ++a) store(w, p->ends[a]);
    free(begun);
    free(rate);
    free(blocks);
}

static void write_reading(po_writer *const w, const po_instant_places *const at)
{
    const po_plan *const p = w->plan;
    po_trace *const t = &w->trace;
    for (int64_t i = -2; i < p->channels; ++i) {
        const int64_t slot = i == -2 ? p->time : i == -1 ? p->drive : p->channel + i;
        set(w, slot, loaded(t, M_LOAD, AT_SLOTS, slot * w->stride));
        for (int g = 0; g < w->many; ++g)
            if (at->clocks >> g & 1)
                rows_at(w, slot)[g] = product(
                    t, loaded(t, M_LOAD, AT_SLOTS, at->late + 8 * (i + 2)),
                    loaded(t, M_ROW, AT_SLOTS, at->clock + 32 * g));
    }
    write_list(w, p->reading);
    store(w, p->read);
}

/* Several samples of one sub-step each, their readings behind one another: states wait in registers
   and not in memory for the next one. */
static void write_several(po_writer *const w, const po_instant_places *const at, const int count)
{
    const po_plan *const p = w->plan;
    for (int k = 0; k < count && !w->trace.failed; ++k) {
        set(w, p->slope, loaded(&w->trace, M_LOAD, AT_SLOTS, at->several + 8 * (4 * k + 2)));
        write_step(w, at, k);
        write_list(w, p->reading);
        store_at(w, p->read, at->read + k * w->stride);
    }
    for (int64_t a = 0; a < p->states && !w->trace.failed; ++a) store(w, p->state + a);
    for (int64_t a = 0; a < p->n_ends && !w->trace.failed; ++a) store(w, p->ends[a]);
}

/* Where rows may be other than zero; to a fixed point, because states follow one another. */
static void spread(const po_plan *const p, const po_list list, uint64_t *const groups,
                   const int moved, int *const changed)
{
    for (const po_operation *o = p->operations + list.first, *end = o + list.count; o < end; ++o) {
        const int *const A = p->slots + o->at;
        const int terms = terms_of(o);
        uint64_t found = 0;
        if (terms) {
            for (int k = 0; k < terms; ++k) found |= groups[A[2 * k + 1]];
            *changed |= (found & ~groups[A[0]]) != 0;
            groups[A[0]] |= found;
        } else if (o->plain == po_product || o->plain == po_quotient) {
            found = groups[A[0]] | groups[A[1]];
            *changed |= (found & ~groups[A[2]]) != 0;
            groups[A[2]] |= found;
        } else if (o->words_moved)
            for (const po_word *one = o->words_moved; one->word != PO_END; ++one)
                if (one->word == PO_SLOPE) {
                    uint64_t *const to = groups + A[o->inputs + (int)one->number];
                    *changed |= (groups[A[one->b]] & ~*to) != 0;
                    *to |= groups[A[one->b]];
                }
    }
}

static void join(uint64_t *const to, const uint64_t more, int *const changed)
{
    *changed |= (more & ~*to) != 0;
    *to |= more;
}

static void spread_all(const po_plan *const p, uint64_t *const groups, const uint64_t clocks)
{
    int changed = 1;
    groups[p->time] |= clocks;
    groups[p->drive] |= clocks;
    groups[p->length] |= clocks;
    for (int64_t i = 0; i < p->channels; ++i) groups[p->channel + i] |= clocks;
    while (changed) {
        changed = 0;
        spread(p, p->once, groups, 1, &changed);
        spread(p, p->weigh, groups, 1, &changed);
        spread(p, p->driven, groups, 1, &changed);
        spread(p, p->stage, groups, 1, &changed);
        spread(p, p->reading, groups, 1, &changed);
        spread(p, p->jump, groups, 1, &changed);
        for (int64_t a = 0; a < p->n_moving; ++a)
            join(groups + p->moving[a], groups[p->rates[a]] | clocks, &changed);
        for (int64_t a = 0; a < p->n_jumping; ++a)
            join(groups + p->jumping[a], groups[p->after[a]], &changed);
        for (const po_block *b = p->blocks; b < p->blocks + p->n_blocks; ++b) {
            uint64_t every = clocks;
            for (int i = 0; i < b->size; ++i) {
                every |= groups[b->state[i]];
                if (!b->quiet[i]) every |= groups[b->rate[i]];
            }
            for (int i = 0; i < b->size * b->size; ++i) every |= groups[b->matrix[i]];
            for (int i = 0; i < 6 * b->size * b->size; ++i)
                every |= groups[p->weights + b->weights + i];
            for (int i = 0; i < b->size; ++i) join(groups + b->state[i], every, &changed);
        }
    }
}

static void code_release(po_code *const code)
{
    if (code->memory) munmap(code->memory, code->bytes);
    free(code->groups);
    free(code);
}

void po_release(po_code *const code) { if (code) code_release(code); }

/* Machine code for D directions, or null where there can be none. MOVES and CLOCKS as for po_run;
   S: sensitivities of the states at the start, of which only those that are zero now may be zero
   for ever. TOLD, unless null, takes the instructions of a step, a reading and several samples, and
   COUNTS how many. */
po_code *po_translate(const po_plan *const p, const int *const MOVES, const int *const CLOCKS,
                      const long D, const double *const S, po_instruction *const *const TOLD,
                      int *const COUNTS)
{
    const int many = (int)((D + 3) / 4);
    const long N = (D + 7) / 8;
    if (many > 63 || !__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return NULL;
    po_code *const code = calloc(1, sizeof *code);
    if (!code) return NULL;
    code->groups = calloc(p->count + 1, sizeof(uint64_t));
    po_trace regrouped = empty();
    po_writer w = {.trace = empty(), .plan = p, .groups = code->groups, .many = many,
                   .stride = STRIDE(N), .moved = D > 0};
    w.number = malloc(sizeof(int) * p->count);
    w.row = malloc(sizeof(int) * (p->count * many + 1));
    po_coder c = {.room = 1 << 20};
    c.bytes = mmap(NULL, c.room, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (c.bytes == MAP_FAILED) c.bytes = NULL;
    int *const all = malloc(sizeof(int) * 3 * MOST);
    int good = code->groups && w.trace.list && w.trace.table && regrouped.list && regrouped.table
        && w.number && w.row && c.bytes && all;
    if (good) {
        uint64_t clocks = 0;
        for (long d = 0; d < D; ++d) {
            if (MOVES[d] >= 0) code->groups[MOVES[d]] |= 1ull << d / 4;
            if (CLOCKS && CLOCKS[d]) clocks |= 1ull << d / 4;
            for (int64_t i = 0; i < p->states; ++i)
                if (S[i * D + d] != 0.0) code->groups[p->state + i] |= 1ull << d / 4;
        }
        spread_all(p, code->groups, clocks);
        const po_layout at = layout(p, N);
        const po_instant_places places = {at.instant, at.instant + 8, at.instant + 16, at.clock,
                                          at.several, at.read, clocks};
        int64_t begins[3] = {0};
        int several = 0, length = 0;
        w.kept = at.k;
        for (int which = 0; which < 2 + (several > 1) && good; ++which) {
            emptied(&w.trace);
            for (int64_t i = 0; i < p->count; ++i) w.number[i] = UNKNOWN;
            for (int64_t i = 0; i < p->count * many; ++i) w.row[i] = UNKNOWN;
            if (which == 0) write_step(&w, &places, -1);
            else if (which == 1) write_reading(&w, &places);
            else write_several(&w, &places, several);
            po_trace *const list = together(&w.trace, &regrouped, all);
            begins[which] = coded(list, &c, at.bytes, TOLD ? TOLD[which] : NULL);
            if (TOLD) COUNTS[which] = list->count;
            length += list->count;
            if (which == 1 && !clocks && !p->channels)
                several = length < BRIEF ? 4 : length < 2 * BRIEF ? 2 : 1;
            good = !list->failed && c.size <= c.room;
        }
        if (good) {
            const int64_t page = 4096, bytes = (c.size + page - 1) / page * page;
            munmap(c.bytes + bytes, c.room - bytes);
            c.room = bytes;
            good = !mprotect(c.bytes, bytes, PROT_READ | PROT_EXEC);
            code->step = (po_machine *)(uintptr_t)(c.bytes + begins[0]);
            code->reading = (po_machine *)(uintptr_t)(c.bytes + begins[1]);
            code->several = (po_machine *)(uintptr_t)(c.bytes + begins[2]);
            code->count = several;
            code->spills = 32 * (int64_t)c.spills;
            code->states = p->states;
            code->first = p->state;
        }
    }
    if (c.bytes) {
        if (good) code->memory = c.bytes, code->bytes = c.room;
        else munmap(c.bytes, c.room);
    }
    free(w.trace.list);
    free(w.trace.table);
    free(regrouped.list);
    free(regrouped.table);
    free(all);
    free(w.number);
    free(w.row);
    if (good) return code;
    code_release(code);
    return NULL;
}

/* Whether sensitivities are zero where they must be. */
int po_suits(const po_code *const code, const double *const S, const long D)
{
    for (int64_t i = 0; i < code->states; ++i)
        for (long d = 0; d < D; ++d)
            if (S[i * D + d] != 0.0 && !(code->groups[code->first + i] >> d / 4 & 1)) return 0;
    return 1;
}
#else
void po_release(po_code *const code) {}
po_code *po_translate(const po_plan *const p, const int *const MOVES, const int *const CLOCKS,
                      const long D, const double *const S, void *const *const TOLD,
                      int *const COUNTS) { return NULL; }
int po_suits(const po_code *const code, const double *const S, const long D) { return 0; }
#endif
