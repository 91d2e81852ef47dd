/* What every function of an effect is written with; see core.c. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

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
typedef void po_any(void);
typedef struct { int word, a, b; double number; po_any *called; } po_word;

typedef struct { po_prepare *prepare; po_evaluate *evaluate; const po_word *words; } po_function;

#define PO_NUMBER(at) (*(double *)(B + (at)))
#define PO_ROWS(at) ((po_row *)(B + (at) + 64))
