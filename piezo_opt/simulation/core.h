/* What every function of an effect is written with; see core.c. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

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

/* Derivatives of one number by eight directions. */
typedef double po_row __attribute__((vector_size(64)));

/* An effect's function finds its inputs and outputs by their places A in the memory B: a number,
   and a line further on the N rows of its derivatives. What follows from parameters alone is
   computed once a run by its preparation and kept in K. */
typedef void po_prepare(const int *A, const char *B, double *K);
typedef void po_evaluate(const int *A, char *B, const double *K, long N);

/* The same as words, each of which names earlier ones by their numbers a and b; see machine.h. */
enum {
    PO_CONSTANT, PO_READ, PO_KEPT, PO_SAME, PO_ADD, PO_SUB, PO_MUL, PO_DIV, PO_MIN, PO_MAX,
    PO_LESS, PO_AT_MOST, PO_EQUAL, PO_UNEQUAL, PO_AND, PO_OR, PO_NOT, PO_WHERE, PO_MINUS,
    PO_SQUARE, PO_TWICE, PO_INVERSE, PO_ROOT, PO_SIZE, PO_SIGN, PO_POWER, PO_CALL, PO_CALL_TWO,
    PO_OUTPUT, PO_SLOPE, PO_END
};
enum { PO_OTHER, PO_TANH }; /* kinds of calls: the word's b */
typedef void po_any(void);
typedef struct { int word, a, b; double number; po_any *called; } po_word;

typedef struct { po_prepare *prepare; po_evaluate *evaluate; const po_word *words; } po_function;

#define PO_NUMBER(at) (*(double *)(B + (at)))
#define PO_ROWS(at) ((po_row *)(B + (at) + 64))
