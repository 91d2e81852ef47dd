/* A quadratic program over a horizon, and the linearisation of a model along one.

   States z (NZ: those of the model, and the drive as the last one), one input w (the drive's move
   in a period), one output:

       z' = A z + B w,   y = C z
       min  sum over stages  q/2 (y - e)^2 + R/2 w^2 + g w
       with w, the drive and (softly, at the price rho) y within limits

   Mehrotra's predictor and corrector; each direction by Riccati's recursion, whose cost grows with
   the horizon alone. Sources: Rao, Wright & Rawlings (1998), J. Optim. Theory Appl. 99, 723-757;
   Nocedal & Wright (2006), Numerical Optimization, sec. 16.6. Nothing is allocated. */

#define SIDES 6 /* lower and upper of w, of the drive, of y */
#define HUGE_LIMIT 1e29

typedef struct {
  double s, dual, extra, price; /* slack, multiplier; how far a soft limit is passed, its dual */
  double ds, ddual, dextra;
  double fall, fall_extra; /* of the products of the first two and of the last two, in a step */
  double weight, target, by_dual, by_price;
} Side;

typedef struct {
  long n, most;
  const double *A, *B, *C, *e, *q, *g, *limits; /* limits: N x 6 */
  double R, rho;
} Program;

static void forward(const Program *m, const double *w, double *z) {
  double now[NZ] = {0.0};
  for (long k = 0; k < m->n; ++k) {
    const double *A = m->A + k * NZ * NZ, *B = m->B + k * NZ;
    double next[NZ];
    for (int i = 0; i < NZ; ++i) {
      double sum = B[i] * w[k];
      for (int j = 0; j < NZ; ++j) sum += A[i * NZ + j] * now[j];
      next[i] = sum;
    }
    for (int i = 0; i < NZ; ++i) now[i] = z[k * NZ + i] = next[i];
  }
}

static double output(const double *C, const double *z) {
  double sum = 0.0;
  for (int i = 0; i < NZ; ++i) sum += C[i] * z[i];
  return sum;
}

/* Backward pass; with factor = 0 only the linear terms (the matrices are those of last time). */
static void backward(const Program *m, const double *w, const double *z, const Side *sides,
                     double *gain, int factor) {
  double P[NZ][NZ] = {{0.0}}, p[NZ] = {0.0};
  for (long k = m->n - 1; k >= 0; --k) {
    const double *A = m->A + k * NZ * NZ, *B = m->B + k * NZ, *C = m->C + k * NZ;
    const Side *s = sides + k * SIDES;
    double own[3] = {m->R * w[k] + m->g[k], 0.0, m->q[k] * (output(C, z + k * NZ) - m->e[k])};
    double bend[3] = {m->R, 0.0, m->q[k]};
    for (int i = 0; i < SIDES; ++i) {
      if (!(s[i].dual > 0.0)) continue;
      const double sign = i % 2 ? -1.0 : 1.0;
      own[i / 2] -= sign * (s[i].dual + s[i].weight * s[i].target);
      bend[i / 2] += s[i].weight;
    }
    for (int i = 0; i < NZ; ++i) p[i] += own[2] * C[i];
    p[NZ - 1] += own[1];
    double *K = gain + k * (NZ + 2), f = own[0];
    for (int i = 0; i < NZ; ++i) f += B[i] * p[i];
    if (factor) {
      for (int i = 0; i < NZ; ++i)
        for (int j = 0; j < NZ; ++j) P[i][j] += bend[2] * C[i] * C[j];
      P[NZ - 1][NZ - 1] += bend[1];
      double PB[NZ], PA[NZ][NZ], G = bend[0];
      for (int i = 0; i < NZ; ++i) {
        double sum = 0.0;
        for (int j = 0; j < NZ; ++j) sum += P[i][j] * B[j];
        PB[i] = sum;
        G += B[i] * sum;
      }
      for (int j = 0; j < NZ; ++j) {
        double sum = 0.0;
        for (int i = 0; i < NZ; ++i) sum += A[i * NZ + j] * PB[i];
        K[j] = sum / G;
      }
      for (int i = 0; i < NZ; ++i)
        for (int j = 0; j < NZ; ++j) {
          double sum = 0.0;
          for (int l = 0; l < NZ; ++l) sum += P[i][l] * A[l * NZ + j];
          PA[i][j] = sum;
        }
      for (int i = 0; i < NZ; ++i)
        for (int j = i; j < NZ; ++j) {
          double sum = -K[i] * K[j] * G;
          for (int l = 0; l < NZ; ++l) sum += A[l * NZ + i] * PA[l][j];
          P[i][j] = P[j][i] = sum;
        }
      K[NZ] = G;
    }
    double next[NZ];
    for (int j = 0; j < NZ; ++j) {
      double sum = -K[j] * f;
      for (int i = 0; i < NZ; ++i) sum += A[i * NZ + j] * p[i];
      next[j] = sum;
    }
    for (int j = 0; j < NZ; ++j) p[j] = next[j];
    K[NZ + 1] = f / K[NZ];
  }
}

/* Steps of w, drive and output (3 a stage), and of the states. */
static void direction(const Program *m, const double *gain, double *step, double *dz) {
  double now[NZ] = {0.0};
  for (long k = 0; k < m->n; ++k) {
    const double *A = m->A + k * NZ * NZ, *B = m->B + k * NZ, *K = gain + k * (NZ + 2);
    double dw = -K[NZ + 1], next[NZ];
    for (int i = 0; i < NZ; ++i) dw -= K[i] * now[i];
    for (int i = 0; i < NZ; ++i) {
      double sum = B[i] * dw;
      for (int j = 0; j < NZ; ++j) sum += A[i * NZ + j] * now[j];
      next[i] = sum;
    }
    for (int i = 0; i < NZ; ++i) now[i] = dz[k * NZ + i] = next[i];
    step[3 * k] = dw;
    step[3 * k + 1] = now[NZ - 1];
    step[3 * k + 2] = output(m->C + k * NZ, now);
  }
}

static void side_steps(const Program *m, const double *step, Side *sides, double *reach) {
  double most = 1.0;
  for (long k = 0; k < m->n; ++k)
    for (int i = 0; i < SIDES; ++i) {
      Side *s = sides + k * SIDES + i;
      if (!(s->dual > 0.0)) continue;
      const double sign = i % 2 ? -1.0 : 1.0, moved = sign * step[3 * k + i / 2];
      s->ddual = s->weight * (s->target - moved);
      s->dextra = (s->fall_extra + s->extra * s->ddual) * s->by_price;
      s->ds = (s->fall - s->s * s->ddual) * s->by_dual;
      if (s->ds * most < -s->s) most = -s->s / s->ds;
      if (s->ddual * most < -s->dual) most = -s->dual / s->ddual;
      if (s->price > 0.0) {
        if (s->dextra * most < -s->extra) most = -s->extra / s->dextra;
        if (-s->ddual * most < -s->price) most = s->price / s->ddual;
      }
    }
  *reach = most;
}

/* Solves the program from w; returns the iterations, or -1 where numbers stopped being finite. */
static long solve_program(const Program *m, double *w, double *work, double *gap_out) {
  const long n = m->n;
  Side *sides = (Side *)work;
  double *gain = work + n * (long)(SIDES * (sizeof(Side) / sizeof(double)));
  double *step = gain + n * (NZ + 2), *dz = step + 3 * n, *z = dz + n * NZ;
  long count = 0, passed = 0;
  forward(m, w, z);
  /* Without limits first: one recursion. */
  for (long k = 0; k < n * SIDES; ++k) {
    Side *s = sides + k;
    s->s = s->dual = s->extra = s->price = s->ds = s->ddual = s->dextra = s->weight = s->target = 0.0;
    s->fall = s->fall_extra = s->by_dual = s->by_price = 0.0;
  }
  backward(m, w, z, sides, gain, 1);
  direction(m, gain, step, dz);
  double scale = 0.0;
  for (long k = 0; k < n; ++k) {
    const double *limit = m->limits + k * SIDES;
    const double value[3] = {w[k], z[k * NZ + NZ - 1], output(m->C + k * NZ, z + k * NZ)};
    for (int i = 0; i < SIDES; ++i) {
      if (fabs(limit[i]) > HUGE_LIMIT) continue;
      const double sign = i % 2 ? -1.0 : 1.0;
      if (sign * (value[i / 2] + step[3 * k + i / 2] - limit[i]) < 0.0) ++passed;
      ++count;
    }
    const double off = value[2] - m->e[k];
    scale += m->q[k] * off * off + m->R * w[k] * w[k];
  }
  if (!passed) {
    for (long k = 0; k < n; ++k) w[k] += step[3 * k];
    *gap_out = 0.0;
    for (long k = 0; k < n; ++k)
      if (!isfinite(w[k])) return -1;
    return 0;
  }
  /* Slacks as large as a typical room; multipliers for a common product with them, which is what
     the cost is for each of the limits that the step would pass. */
  const double start = fmax(scale / (double)passed, 1e-14);
  for (long k = 0; k < n; ++k) {
    const double *limit = m->limits + k * SIDES;
    const double value[3] = {w[k], z[k * NZ + NZ - 1], output(m->C + k * NZ, z + k * NZ)};
    for (int i = 0; i < SIDES; ++i) {
      if (fabs(limit[i]) > HUGE_LIMIT) continue;
      Side *s = sides + k * SIDES + i;
      const double sign = i % 2 ? -1.0 : 1.0, room = sign * (value[i / 2] - limit[i]);
      double wide = limit[i | 1] - limit[i & ~1];
      if (!(wide < HUGE_LIMIT)) wide = fabs(room) + fabs(limit[i]);
      s->s = fmax(room, 0.05 * wide);
      s->dual = start / s->s;
      if (i >= 4) {
        if (s->dual > 0.5 * m->rho) s->dual = 0.5 * m->rho;
        s->price = m->rho - s->dual;
        s->extra = start / s->price;
      }
    }
  }
  double gap = start;
  long done = 0;
  for (; done < m->most; ++done) {
    double mu = 0.0, reach = 1.0;
    for (int pass = 0; pass < 2; ++pass) {
      /* The corrector's aim: the share of the gap that the predictor leaves, cubed. */
      double centre = 0.0;
      if (pass) {
        double ahead = 0.0;
        for (long k = 0; k < n * SIDES; ++k) {
          Side *s = sides + k;
          if (!(s->dual > 0.0)) continue;
          ahead += (s->s + reach * s->ds) * (s->dual + reach * s->ddual);
          if (s->price > 0.0)
            ahead += (s->extra + reach * s->dextra) * (s->price - reach * s->ddual);
        }
        const double share = ahead / (mu > 0.0 ? mu : 1.0);
        centre = share * share * share * mu / (double)count;
      }
      for (long k = 0; k < n; ++k) {
        const double *limit = m->limits + k * SIDES;
        double value[3] = {w[k], z[k * NZ + NZ - 1], 0.0};
        if (!pass) value[2] = output(m->C + k * NZ, z + k * NZ);
        for (int i = 0; i < SIDES; ++i) {
          Side *s = sides + k * SIDES + i;
          if (!(s->dual > 0.0)) continue;
          double more = centre, more_extra = centre;
          if (pass) {
            more -= reach * reach * s->ds * s->ddual;
            if (s->price > 0.0) more_extra += reach * reach * s->dextra * s->ddual;
          } else {
            const double sign = i % 2 ? -1.0 : 1.0;
            s->by_dual = 1.0 / s->dual;
            s->by_price = s->price > 0.0 ? 1.0 / s->price : 0.0;
            more -= s->s * s->dual;
            more_extra -= s->extra * s->price;
            mu -= more + more_extra;
            s->weight = 1.0 / (s->s * s->by_dual + s->extra * s->by_price);
            s->target = s->s - s->extra - sign * (value[i / 2] - limit[i]);
            s->fall = s->fall_extra = 0.0;
          }
          s->fall += more;
          s->fall_extra += more_extra;
          s->target += more * s->by_dual - more_extra * s->by_price;
        }
      }
      backward(m, w, z, sides, gain, pass == 0);
      direction(m, gain, step, dz);
      side_steps(m, step, sides, &reach);
    }
    reach *= reach < 1.0 ? 0.995 : 1.0;
    gap = 0.0;
    for (long k = 0; k < n; ++k) {
      w[k] += reach * step[3 * k];
      for (int i = 0; i < NZ; ++i) z[k * NZ + i] += reach * dz[k * NZ + i];
    }
    for (long k = 0; k < n * SIDES; ++k) {
      Side *s = sides + k;
      if (!(s->dual > 0.0)) continue;
      s->s += reach * s->ds;
      s->dual += reach * s->ddual;
      if (s->price > 0.0) {
        s->extra += reach * s->dextra;
        s->price -= reach * s->ddual;
      }
      gap += s->s * s->dual;
    }
    if (!isfinite(gap)) return -1;
    if (gap < TOLERANCE * (scale + 1e-300) && reach > 0.9) {
      ++done;
      break;
    }
  }
  *gap_out = gap / (double)count;
  return done;
}
