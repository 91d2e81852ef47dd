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
typedef struct { po_prepare *prepare; po_evaluate *evaluate; } po_function;

#define PO_NUMBER(at) (*(double *)(B + (at)))
#define PO_ROWS(at) ((po_row *)(B + (at) + 64))
