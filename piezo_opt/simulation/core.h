/* What every function of an effect is written with; see core.c. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Derivatives of one number by eight directions. */
typedef double po_row __attribute__((vector_size(64)));

/* An effect's function finds its inputs and outputs by the slots A in the numbers V. What follows
   from parameters alone is computed once a run by its preparation and kept in K. N rows in T lie
   beside each number; without them T is not touched. */
typedef void po_prepare(const int *A, const double *V, double *K);
typedef void po_evaluate(const int *A, double *V, const double *K, po_row *T, long N);
typedef struct { po_prepare *prepare; po_evaluate *evaluate; } po_function;
