/* From a list of instructions to machine code.
 *
 * Every result in the list has one number, and what is said twice is one instruction. Products are
 * joined with the only sum that they are for, and what nobody needs is left out. Then the list is
 * translated one by one. Every value is a register of four numbers, a plain number four times the
 * same one, but for what four calls of a function at once take and give. Registers are given away
 * by the next use of what they hold (Belady 1966, IBM Systems Journal 5(2), 78-101), which a list
 * without branches tells exactly.
 *
 * Only for processors with AVX2 under the System V ABI.
 */
#if defined(__x86_64__) && !defined(_WIN32)
#include <sys/mman.h>
#define PO_MACHINE 1

enum {
    M_LOAD, M_ROW, M_CONSTANT, M_ADD, M_SUB, M_MUL, M_DIV, M_MIN, M_MAX, M_AND, M_CLEAR, M_FLIP,
    M_PAIR, M_QUAD, M_ROOT, M_COMPARE, M_LANE, M_JOIN, M_LESS_JOIN, M_JOIN_LESS, M_CALL, M_POWER,
    M_CALL_FOUR, M_STORE, M_STORE_ROW
};
enum { AT_SLOTS = 3, AT_WEIGHTS = 5, AT_WEIGHT_ROWS = 14, AT_CONSTANTS = -1 }; /* registers */
enum { NOTHING = -1, UNKNOWN = -2, NEVER = 1 << 30, MOST = 40000, BRIEF = 500, REGISTERS = 16 };

/* One instruction, whose number is that of its result: c + a b is a join. */
typedef struct {
    /* detail: kind of comparison, base register, which of four numbers, or kind of call */
    int op, detail, in[3], place;
    union { double number; po_any *called; } by;
} po_instruction;

typedef struct {
    po_instruction *list;
    int count, room, *table, width; /* table of the numbers by a hash of what they say */
    int failed;
} po_trace;

/* tanh of four numbers as po_tanh of one, by a power series in the place of tables. */
typedef double po_four __attribute__((vector_size(32)));
typedef int64_t po_four_bits __attribute__((vector_size(32)));
__attribute__((target("avx2,fma"))) static po_four po_tanh_four(const po_four x)
{
    const po_four_bits sign = (po_four_bits)x & INT64_MIN, size = (po_four_bits)x & INT64_MAX;
    const po_four_bits far = (po_four)size > 354.0; /* its exponential ends there */
    const po_four_bits end = (po_four_bits)(354.0 + (po_four){0});
    const po_four v = -2.0 * (po_four)((far & end) | (~far & size));
    /* v = k log 2 + r, k the last bits of a large number */
    const po_four shifted = v * 0x1.71547652b82fep0 + 0x1.8p52, k = shifted - 0x1.8p52;
    const po_four r = (v - k * 0x1.62e42fefa0000p-1) - k * 0x1.cf79abc9e3b39p-40;
    const po_four r2 = r * r, r4 = r2 * r2;
    const po_four low = (1.0 + r) + r2 * (1.0 / 2 + r * (1.0 / 6));
    const po_four middle = (1.0 / 24 + r * (1.0 / 120)) + r2 * (1.0 / 720 + r * (1.0 / 5040));
    const po_four high =
        (1.0 / 40320 + r * (1.0 / 362880)) + r2 * (1.0 / 3628800 + r * (1.0 / 39916800));
    const po_four last = 1.0 / 479001600 + r * (1.0 / 6227020800);
    const po_four part = low + r4 * (middle + r4 * (high + r4 * last));
    /* What is no number stays none. */
    const po_four y = (po_four)((po_four_bits)part + ((po_four_bits)shifted << 52)) + 0.0 * v;
    return (po_four)((po_four_bits)((1.0 - y) / (1.0 + y)) | sign);
}

static po_trace empty(void)
{
    po_trace t = {0};
    t.room = MOST;
    t.width = 1 << 17;
    t.list = malloc(sizeof(po_instruction) * MOST);
    t.table = malloc(sizeof(int) * t.width);
    return t;
}

static void emptied(po_trace *const t)
{
    memset(t->table, 255, sizeof(int) * t->width);
    t->count = t->failed = 0;
}

static unsigned hashed(const po_instruction *const one)
{
    const unsigned char *const bytes = (const unsigned char *)one;
    unsigned found = 2166136261u;
    for (unsigned i = 0; i < sizeof *one; i += 4) {
        unsigned part;
        memcpy(&part, bytes + i, 4);
        found = (found ^ part) * 16777619u;
        found ^= found >> 13;
    }
    return found;
}

static int *sought(const po_trace *const t, const po_instruction *const one)
{
    unsigned at = hashed(one) & (t->width - 1);
    while (t->table[at] != NOTHING && memcmp(t->list + t->table[at], one, sizeof *one))
        at = (at + 1) & (t->width - 1);
    return t->table + at;
}

static int said(po_trace *const t, const po_instruction one)
{
    int *const known = one.op < M_STORE ? sought(t, &one) : NULL;
    if (known && *known != NOTHING) return *known;
    if (t->count == t->room) {
        t->failed = 1;
        return 0;
    }
    if (known) *known = t->count;
    t->list[t->count] = one;
    return t->count++;
}

static po_instruction plain(const int op, const int a, const int b, const int c)
{
    po_instruction one;
    memset(&one, 0, sizeof one);
    one.op = op;
    one.in[0] = a, one.in[1] = b, one.in[2] = c;
    return one;
}

static int loaded(po_trace *const t, const int op, const int base, const int64_t place)
{
    po_instruction one = plain(op, NOTHING, NOTHING, NOTHING);
    one.detail = base;
    one.place = (int)place;
    return said(t, one);
}

static int constant(po_trace *const t, const double number)
{
    po_instruction one = plain(M_CONSTANT, NOTHING, NOTHING, NOTHING);
    one.by.number = number;
    return said(t, one);
}

static int is(const po_trace *const t, const int k, const double number)
{
    return t->list[k].op == M_CONSTANT && t->list[k].by.number == number;
}

typedef struct {
    const po_trace *t;
    unsigned char *bytes;
    int64_t size, room;
    int *reg, *use, *spilled, *after; /* of each value; after: of each operand its next use */
    unsigned char *lost;
    int held[REGISTERS], spills, *constant_at;
    int left[3], n_left, *room_left, n_room_left; /* places whose values are not needed any more */
    int64_t spill;
} po_coder;

static void byte(po_coder *const c, const int b)
{
    if (c->size < c->room) c->bytes[c->size] = (unsigned char)b;
    ++c->size;
}

static void whole(po_coder *const c, const int64_t number, const int bytes)
{
    for (int i = 0; i < bytes; ++i) byte(c, (int)(number >> 8 * i & 255));
}

typedef struct { int memory, base; int64_t place; } po_operand; /* a register is its base */

/* A VEX instruction of four lanes; narrow: of one. */
static void vex(po_coder *const c, const int map, const int pp, const int wide, const int narrow,
                const int opcode, const int to, const int from, const po_operand by, const int tail)
{
    const int base = by.base < 0 ? 0 : by.base;
    if (map == 1 && !wide && base < 8) {
        byte(c, 0xc5);
        byte(c, (to < 8) << 7 | (~from & 15) << 3 | !narrow << 2 | pp);
    } else {
        byte(c, 0xc4);
        byte(c, (to < 8) << 7 | 1 << 6 | (base < 8) << 5 | map);
        byte(c, wide << 7 | (~from & 15) << 3 | !narrow << 2 | pp);
    }
    byte(c, opcode);
    if (!by.memory) byte(c, 0xc0 | (to & 7) << 3 | (base & 7));
    else if (by.base < 0) {
        byte(c, 0x05 | (to & 7) << 3);
        whole(c, by.place - (c->size + 4 + tail), 4);
    } else if (by.place >= -128 && by.place < 128) {
        byte(c, 0x40 | (to & 7) << 3 | (base & 7));
        whole(c, by.place, 1);
    } else {
        byte(c, 0x80 | (to & 7) << 3 | (base & 7));
        whole(c, by.place, 4);
    }
}

static po_operand in_register(const int r) { return (po_operand){0, r, 0}; }
static po_operand in_memory(const int base, const int64_t at) { return (po_operand){1, base, at}; }

static po_operand spill_of(const po_coder *const c, const int v)
{
    return in_memory(AT_SLOTS, c->spill + 32 * c->spilled[v]);
}

static int in_store(const po_coder *const c, const int v)
{
    return c->spilled[v] >= 0 || (c->t->list[v].op <= M_CONSTANT && !c->lost[v]);
}

static void save(po_coder *const c, const int v)
{
    if (in_store(c, v)) return;
    c->spilled[v] = c->n_room_left ? c->room_left[--c->n_room_left] : c->spills++;
    vex(c, 1, 1, 0, 0, 0x29, c->reg[v], 0, spill_of(c, v), 0);
}

static void let_go(po_coder *const c, const int v)
{
    if (c->reg[v] >= 0) c->held[c->reg[v]] = NOTHING;
    c->reg[v] = NOTHING;
}

/* A register, if need be that of what is used last; locked ones are bits. */
static int take(po_coder *const c, const unsigned locked)
{
    int last = NOTHING;
    for (int r = 0; r < REGISTERS; ++r) {
        if (locked >> r & 1) continue;
        if (c->held[r] == NOTHING) return r;
        if (last == NOTHING || c->use[c->held[r]] > c->use[c->held[last]]) last = r;
    }
    const int v = c->held[last];
    if (c->use[v] < NEVER) save(c, v);
    let_go(c, v);
    return last;
}

static void load(po_coder *const c, const int v, const int r)
{
    const po_instruction *const one = c->t->list + v;
    if (c->spilled[v] >= 0) vex(c, 1, 1, 0, 0, 0x28, r, 0, spill_of(c, v), 0);
    else if (one->op == M_ROW) vex(c, 1, 1, 0, 0, 0x28, r, 0, in_memory(one->detail, one->place), 0);
    else if (one->op == M_CONSTANT && one->by.number == 0.0 && !signbit(one->by.number))
        vex(c, 1, 1, 0, 0, 0x57, r, r, in_register(r), 0);
    else {
        const int constant = one->op == M_CONSTANT;
        const po_operand from = constant ? in_memory(AT_CONSTANTS, 8 * (int64_t)c->constant_at[v])
                                         : in_memory(one->detail, one->place);
        vex(c, 2, 1, 0, 0, 0x19, r, 0, from, 0);
    }
    c->reg[v] = r;
    c->held[r] = v;
}

static int ensure(po_coder *const c, const int v, unsigned *const locked)
{
    if (c->reg[v] == NOTHING) load(c, v, take(c, *locked));
    *locked |= 1u << c->reg[v];
    return c->reg[v];
}

/* Where an instruction may find its last operand: in memory, if it is there as four numbers and
   will not be needed again. */
static po_operand last_operand(po_coder *const c, const int v, const int again,
                               unsigned *const locked)
{
    if (c->reg[v] == NOTHING && again == NEVER) {
        const po_instruction *const one = c->t->list + v;
        if (c->spilled[v] >= 0) return spill_of(c, v);
        if (one->op == M_ROW && !c->lost[v]) return in_memory(one->detail, one->place);
    }
    return in_register(ensure(c, v, locked));
}

static void used_up(po_coder *const c, const int v, const int again)
{
    c->use[v] = again;
    if (again < NEVER) return;
    let_go(c, v);
    if (c->spilled[v] < 0) return;
    c->left[c->n_left++] = c->spilled[v];
    c->spilled[v] = NOTHING;
}

static void result(po_coder *const c, const int k, const int r)
{
    c->reg[k] = r;
    c->held[r] = k;
}

static void code_call(po_coder *const c, const int k)
{
    const po_instruction *const one = c->t->list + k;
    const int *const again = c->after + 3 * k;
    unsigned locked = 0;
    for (int i = 0; i < 2 && one->in[i] >= 0; ++i) {
        ensure(c, one->in[i], &locked);
        save(c, one->in[i]);
    }
    for (int r = 0; r < REGISTERS; ++r)
        if (c->held[r] != NOTHING) {
            const int v = c->held[r];
            if (c->use[v] < NEVER) save(c, v);
            let_go(c, v);
        }
    for (int i = 0; i < 2 && one->in[i] >= 0; ++i) {
        load(c, one->in[i], i);
        let_go(c, one->in[i]);
    }
    if (one->op == M_POWER) { /* lea rdi, [rbx + place] */
        byte(c, 0x48), byte(c, 0x8d), byte(c, 0xbb);
        whole(c, one->place, 4);
    }
    if (one->op != M_CALL_FOUR) byte(c, 0xc5), byte(c, 0xf8), byte(c, 0x77); /* vzeroupper */
    byte(c, 0x48), byte(c, 0xb8); /* mov rax, called; call rax */
    whole(c, (int64_t)(uintptr_t)one->by.called, 8);
    byte(c, 0xff), byte(c, 0xd0);
    if (one->op != M_CALL_FOUR) vex(c, 2, 1, 0, 0, 0x19, 0, 0, in_register(0), 0);
    for (int i = 0; i < 2 && one->in[i] >= 0; ++i) used_up(c, one->in[i], again[i]);
    result(c, k, 0);
}

static void code_join(po_coder *const c, const int k)
{
    const po_instruction *const one = c->t->list + k;
    const int *const again = c->after + 3 * k;
    const int a = one->in[0], b = one->in[1], d = one->in[2];
    /* Opcodes of: sum += a b, and a = b a + sum. */
    const int onto = one->op == M_JOIN ? 0xb8 : one->op == M_LESS_JOIN ? 0xbc : 0xba;
    const int into = onto - 0x10;
    unsigned locked = 0;
    int to;
    if (again[2] == NEVER || a == b || (again[0] != NEVER && again[1] != NEVER)) {
        const int ra = ensure(c, a, &locked);
        const po_operand by = last_operand(c, b, again[1], &locked);
        if (again[2] == NEVER && d != a && d != b) to = ensure(c, d, &locked);
        else {
            const int from = ensure(c, d, &locked);
            to = take(c, locked);
            vex(c, 1, 1, 0, 0, 0x28, to, 0, in_register(from), 0);
        }
        vex(c, 2, 1, 1, 0, onto, to, ra, by, 0);
    } else {
        const int dies = again[0] == NEVER ? a : b, other = dies == a ? b : a;
        to = ensure(c, dies, &locked);
        const int ro = ensure(c, other, &locked);
        const po_operand by = last_operand(c, d, again[2], &locked);
        vex(c, 2, 1, 1, 0, into, to, ro, by, 0);
    }
    for (int i = 0; i < 3; ++i) used_up(c, one->in[i], again[i]);
    if (c->held[to] != NOTHING) let_go(c, c->held[to]);
    result(c, k, to);
}

static void code_two(po_coder *const c, const int k)
{
    static const int opcodes[] = {
        [M_ADD] = 0x58, [M_SUB] = 0x5c, [M_MUL] = 0x59, [M_DIV] = 0x5e, [M_MIN] = 0x5d,
        [M_MAX] = 0x5f, [M_AND] = 0x54, [M_CLEAR] = 0x55, [M_FLIP] = 0x57, [M_COMPARE] = 0xc2,
        [M_PAIR] = 0x14, [M_QUAD] = 0x0d,
    };
    const po_instruction *const one = c->t->list + k;
    const int *const again = c->after + 3 * k;
    int a = 0, b = 1;
    unsigned locked = 0;
    /* What can be exchanged is, where the first one is in memory alone. */
    if ((one->op == M_ADD || one->op == M_MUL) && c->reg[one->in[0]] == NOTHING
        && c->reg[one->in[1]] != NOTHING)
        a = 1, b = 0;
    const int from = ensure(c, one->in[a], &locked);
    const po_operand by = last_operand(c, one->in[b], again[b], &locked);
    for (int i = 0; i < 2; ++i) used_up(c, one->in[i], again[i]);
    const unsigned kept = by.memory ? 0 : 1u << by.base;
    const int to = take(c, (c->held[from] != NOTHING ? 1u << from : 0)
                               | (by.memory || c->held[by.base] == NOTHING ? 0 : kept));
    const int quad = one->op == M_QUAD, told = quad || one->op == M_COMPARE;
    vex(c, quad ? 3 : 1, 1, 0, 0, opcodes[one->op], to, from, by, told);
    if (told) byte(c, quad ? 0xc : one->detail); /* the second one's upper half */
    result(c, k, to);
}

static void code_store(po_coder *const c, const int k)
{
    const po_instruction *const one = c->t->list + k;
    const int row = one->op == M_STORE_ROW;
    po_instruction old = plain(row ? M_ROW : M_LOAD, NOTHING, NOTHING, NOTHING);
    unsigned locked = 0;
    old.detail = one->detail;
    old.place = one->place;
    const int from = ensure(c, one->in[0], &locked), was = *sought(c->t, &old);
    if (was != NOTHING && c->use[was] < NEVER && c->spilled[was] < 0) {
        ensure(c, was, &locked); /* what stood here is still needed */
        c->lost[was] = 1;
    }
    const po_operand to = in_memory(one->detail, one->place);
    if (row) vex(c, 1, 1, 0, 0, 0x29, from, 0, to, 0);
    else vex(c, 1, 3, 0, 1, 0x11, from, 0, to, 0);
    used_up(c, one->in[0], c->after[3 * k]);
}

static void code(po_coder *const c, const int k)
{
    const po_instruction *const one = c->t->list + k;
    if (one->op <= M_CONSTANT) return;
    /* Not before now: the instruction itself may have read them there. */
    while (c->n_left) c->room_left[c->n_room_left++] = c->left[--c->n_left];
    if (one->op >= M_CALL && one->op <= M_CALL_FOUR) code_call(c, k);
    else if (one->op >= M_STORE) code_store(c, k);
    else if (one->op >= M_JOIN && one->op <= M_JOIN_LESS) code_join(c, k);
    else if (one->op == M_ROOT || one->op == M_LANE) {
        unsigned locked = 0;
        const int from = ensure(c, one->in[0], &locked), to = take(c, locked);
        if (one->op == M_ROOT) vex(c, 1, 1, 0, 0, 0x51, to, 0, in_register(from), 0);
        else {
            vex(c, 3, 1, 1, 0, 0x01, to, 0, in_register(from), 1);
            byte(c, 0x55 * one->detail);
        }
        used_up(c, one->in[0], c->after[3 * k]);
        result(c, k, to);
    } else code_two(c, k);
}

/* How often each result is needed. */
static void counted(const po_trace *const t, int *const uses)
{
    memset(uses, 0, sizeof(int) * t->count);
    for (int k = t->count - 1; k >= 0; --k)
        if (t->list[k].op >= M_STORE || uses[k])
            for (int i = 0; i < 3; ++i) if (t->list[k].in[i] >= 0) ++uses[t->list[k].in[i]];
}

/* A list in which calls of one function that do not wait for each other are made four at a time.
   new: of each number of the old list that in the new one; waiting: of what is not there yet. */
typedef struct {
    const po_trace *old;
    po_trace *made;
    int *new, *waiting, calls[4], n_calls, n_waiting;
} po_mover;

static void call_together(po_mover *const m)
{
    po_trace *const t = m->made;
    const int n = m->n_calls;
    po_instruction one = m->old->list[m->calls[0]];
    int in[4];
    for (int i = 0; i < 4; ++i) in[i] = m->new[m->old->list[m->calls[i < n ? i : 0]].in[0]];
    m->n_calls = 0;
    if (n == 1) {
        one.in[0] = in[0];
        m->new[m->calls[0]] = said(t, one);
        return;
    }
    one = plain(M_CALL_FOUR, said(t, plain(M_QUAD, said(t, plain(M_PAIR, in[0], in[1], NOTHING)),
                                           said(t, plain(M_PAIR, in[2], in[3], NOTHING)), NOTHING)),
                NOTHING, NOTHING);
    one.by.called = (po_any *)po_tanh_four;
    const int four = said(t, one);
    for (int i = 0; i < n; ++i) {
        po_instruction lane = plain(M_LANE, four, NOTHING, NOTHING);
        lane.detail = i;
        m->new[m->calls[i]] = said(t, lane);
    }
}

/* Whether an instruction could be taken over, or waits to be called. */
static int moved_over(po_mover *const m, const int k)
{
    po_instruction one = m->old->list[k];
    for (int i = 0; i < 3; ++i) {
        if (one.in[i] < 0) continue;
        if (m->new[one.in[i]] < 0) return 0;
        one.in[i] = m->new[one.in[i]];
    }
    if (one.op == M_CALL && one.detail == PO_TANH) m->calls[m->n_calls++] = k;
    else m->new[k] = said(m->made, one);
    return 1;
}

/* The list with calls together, if it has several; all: room for three numbers an instruction. */
static po_trace *together(po_trace *const old, po_trace *const made, int *const all)
{
    const int n = old->count;
    int *const uses = all;
    int calls = 0;
    for (int k = 0; k < n; ++k)
        calls += old->list[k].op == M_CALL && old->list[k].detail == PO_TANH;
    if (calls < 2 || old->failed) return old;
    emptied(made);
    po_mover m = {old, made, all + n, all + 2 * n, {0}, 0, 0};
    counted(old, uses);
    for (int k = 0; k < n; ++k) m.new[k] = NOTHING;
    for (int k = 0; k <= n; ++k) {
        if (k < n) {
            if (!uses[k] && old->list[k].op < M_STORE) continue;
            if (!moved_over(&m, k)) m.waiting[m.n_waiting++] = k;
        }
        while (m.n_calls == 4 || (k == n && m.n_calls)) {
            call_together(&m);
            const int waited = m.n_waiting;
            m.n_waiting = 0;
            for (int i = 0; i < waited; ++i)
                if (m.n_calls == 4 || !moved_over(&m, m.waiting[i]))
                    m.waiting[m.n_waiting++] = m.waiting[i];
        }
    }
    return made;
}

/* Leaves out what nobody needs, and joins products with the only sum that they are for. */
static void joined(po_trace *const t, int *const uses)
{
    counted(t, uses);
    for (int k = 0; k < t->count; ++k) {
        po_instruction *const one = t->list + k;
        if (!uses[k] || (one->op != M_ADD && one->op != M_SUB)) continue;
        for (int i = 1; i >= 0; --i) {
            const int m = one->in[i], other = one->in[1 - i];
            if (t->list[m].op != M_MUL || uses[m] != 1) continue;
            const int op = one->op == M_ADD ? M_JOIN : i == 1 ? M_LESS_JOIN : M_JOIN_LESS;
            uses[m] = 0;
            *one = plain(op, t->list[m].in[0], t->list[m].in[1], other);
            break;
        }
    }
}

/* Bytes of a function that does what a list says, behind its constants; where it begins. */
static int64_t coded(po_trace *const t, po_coder *const c, const int64_t spill,
                     po_instruction *const told)
{
    const int n = t->count + 1;
    int *const all = malloc(sizeof(int) * 9 * n);
    c->lost = calloc(n, 1);
    if (!all || !c->lost || t->failed) {
        free(all);
        free(c->lost);
        t->failed = 1;
        return 0;
    }
    int *const uses = all;
    c->t = t;
    c->reg = all + n, c->use = all + 2 * n, c->spilled = all + 3 * n, c->constant_at = all + 4 * n;
    c->after = all + 5 * n, c->room_left = all + 8 * n;
    c->n_left = c->n_room_left = 0;
    c->spill = spill;
    joined(t, uses);
    for (int k = 0; k < t->count && told; ++k) {
        told[k] = t->list[k];
        if (!uses[k] && told[k].op < M_STORE) told[k].op = NOTHING;
    }
    for (int k = 0; k < t->count; ++k) {
        c->reg[k] = c->spilled[k] = NOTHING;
        c->use[k] = NEVER;
    }
    for (int k = t->count - 1; k >= 0; --k) {
        const int live = uses[k] || t->list[k].op >= M_STORE;
        for (int i = 0; i < 3; ++i) c->after[3 * k + i] = NEVER;
        for (int i = 0; i < 3 && live; ++i)
            if (t->list[k].in[i] >= 0) c->after[3 * k + i] = c->use[t->list[k].in[i]];
        for (int i = 0; i < 3 && live; ++i)
            if (t->list[k].in[i] >= 0) c->use[t->list[k].in[i]] = k;
    }
    for (int r = 0; r < REGISTERS; ++r) c->held[r] = NOTHING;
    while (c->size % 64) byte(c, 0);
    for (int k = 0; k < t->count; ++k)
        if (t->list[k].op == M_CONSTANT && uses[k]) {
            int64_t bits;
            memcpy(&bits, &t->list[k].by.number, 8);
            c->constant_at[k] = (int)(c->size / 8);
            whole(c, bits, 8);
        }
    while (c->size % 64) byte(c, 0);
    const int64_t begins = c->size;
    /* push rbx, rbp, r14; mov rbx, rdi; mov rbp, rsi; mov r14, rdx */
    static const unsigned char first[] = {
        0x53, 0x55, 0x41, 0x56, 0x48, 0x89, 0xfb, 0x48, 0x89, 0xf5, 0x49, 0x89, 0xd6,
    };
    static const unsigned char last[] = {0xc5, 0xf8, 0x77, 0x41, 0x5e, 0x5d, 0x5b, 0xc3};
    for (unsigned i = 0; i < sizeof first; ++i) byte(c, first[i]);
    for (int k = 0; k < t->count; ++k)
        if (uses[k] || t->list[k].op >= M_STORE) code(c, k);
    for (unsigned i = 0; i < sizeof last; ++i) byte(c, last[i]);
    free(all);
    free(c->lost);
    return begins;
}
#endif
