/* Real-time iteration: one linearisation of the model over the horizon, one quadratic program, one
   move of the drive; and the extended Kalman filter that it begins with. period() and reading()
   carry ND directions, of which NX + 2 are used: the states, the drive before, the drive after;
   given null they carry none. Nothing is allocated. Source: Diehl et al. (2002), J. Process Control 12(4), 577-585. */

#define NE (NX + 1) /* estimated: the model's states and a disturbance of the reading */

static void unit_seeds(double *X, double *BEFORE, double *AFTER) {
  for (int i = 0; i < NX * ND; ++i) X[i] = 0.0;
  for (int i = 0; i < NX; ++i) X[i * ND + i] = 1.0;
  for (int d = 0; d < ND; ++d) BEFORE[d] = AFTER[d] = 0.0;
  BEFORE[NX] = AFTER[NX] = AFTER[NX + 1] = 1.0;
}

/* The states x, drive u and readings y along the moves w, and the slopes A, B, C of each period. */
static void linearise(long n, const double *p, double t, double T, const double *x0, double u0,
                      long rise, long held, const double *w, double *A, double *B, double *C,
                      double *y, double *end) {
  double x[NX + 1], X[(NX + 1) * ND], BEFORE[ND], AFTER[ND], Y[ND], u = u0;
  for (int i = 0; i < NX; ++i) x[i] = x0[i];
  for (long k = 0; k < n; ++k) {
    double *a = A + k * NZ * NZ, *b = B + k * NZ, *c = C + k * NZ;
    unit_seeds(X, BEFORE, AFTER);
    period(p, t, u, BEFORE, u + w[k], AFTER, T, rise, held, x, X);
    for (int i = 0; i < NX; ++i) {
      for (int j = 0; j <= NX; ++j) a[i * NZ + j] = X[i * ND + j];
      b[i] = X[i * ND + NX + 1];
    }
    for (int j = 0; j < NX; ++j) a[NX * NZ + j] = 0.0;
    a[NX * NZ + NX] = b[NX] = 1.0;
    u += w[k];
    t += T;
    unit_seeds(X, BEFORE, AFTER);
    AFTER[NX + 1] = 0.0;
    reading(p, t, x, X, u, AFTER, y + k, Y);
    for (int j = 0; j <= NX; ++j) c[j] = Y[j];
  }
  for (int i = 0; i < NX; ++i) end[i] = x[i];
}

/* Whether every number of an estimate is one. */
static int sound(const double *x, const double *P) {
  int all = 1;
  for (int i = 0; i < NE; ++i) all = all && isfinite(x[i]);
  for (int i = 0; i < NE * NE; ++i) all = all && isfinite(P[i]);
  return all;
}

static void taken(const double *new_x, const double *new_P, double *x, double *P) {
  for (int i = 0; i < NE; ++i) x[i] = new_x[i];
  for (int i = 0; i < NE * NE; ++i) P[i] = new_P[i];
}

/* One period of the filter: P (NE x NE) and the estimate move on. Where that leads to what is no
   number it answers 0 and leaves them. */
static int predict(const double *p, double t, double before, double after, double T, long rise,
                   long held, const double *noises, double *x, double *P) {
  double X[(NX + 1) * ND], BEFORE[ND], AFTER[ND], F[NE][NE] = {{0.0}}, M[NE][NE];
  double moved[NE], spread[NE * NE];
  for (int i = 0; i < NE; ++i) moved[i] = x[i];
  unit_seeds(X, BEFORE, AFTER);
  period(p, t, before, BEFORE, after, AFTER, T, rise, held, moved, X);
  for (int i = 0; i < NX; ++i)
    for (int j = 0; j < NX; ++j) F[i][j] = X[i * ND + j];
  F[NX][NX] = 1.0;
  for (int i = 0; i < NE; ++i)
    for (int j = 0; j < NE; ++j) {
      double sum = 0.0;
      for (int l = 0; l < NE; ++l) sum += F[i][l] * P[l * NE + j];
      M[i][j] = sum;
    }
  for (int i = 0; i < NE; ++i)
    for (int j = i; j < NE; ++j) {
      double sum = 0.0;
      for (int l = 0; l < NE; ++l) sum += M[i][l] * F[j][l];
      /* Noise of the drive before and after, and the disturbance's walk. */
      if (j < NX)
        sum += noises[0] * noises[0] *
               (X[i * ND + NX + 1] * X[j * ND + NX + 1] +
                (X[i * ND + NX] - X[i * ND + NX + 1]) * (X[j * ND + NX] - X[j * ND + NX + 1]));
      if (i == NX && j == NX) sum += noises[1] * noises[1];
      spread[i * NE + j] = spread[j * NE + i] = sum;
    }
  if (!sound(moved, spread)) return 0;
  taken(moved, spread, x, P);
  return 1;
}

/* A reading; one that is no number, too far off to be one, or leads to none is a sample of no
   weight. */
static int correct(const double *p, double t, double u, double seen, const double *noises,
                   double *x, double *P) {
  double X[(NX + 1) * ND], BEFORE[ND], AFTER[ND], Y[ND], y, H[NE], PH[NE], S;
  double moved[NE], spread[NE * NE];
  unit_seeds(X, BEFORE, AFTER);
  reading(p, t, x, X, u, BEFORE, &y, Y);
  for (int j = 0; j < NX; ++j) H[j] = Y[j];
  H[NX] = 1.0;
  S = noises[2] * noises[2];
  for (int i = 0; i < NE; ++i) {
    PH[i] = 0.0;
    for (int j = 0; j < NE; ++j) PH[i] += P[i * NE + j] * H[j];
  }
  for (int i = 0; i < NE; ++i) S += H[i] * PH[i];
  const double off = seen - y - x[NX];
  if (!isfinite(off) || !(S > 0.0) || !(fabs(off) < noises[3])) return 0;
  for (int i = 0; i < NE; ++i) moved[i] = x[i] + PH[i] / S * off;
  /* Joseph's form, (I - K H) P (I - K H)' + K R K': rounding leaves it positive. */
  double left[NE][NE];
  for (int i = 0; i < NE; ++i)
    for (int j = 0; j < NE; ++j) left[i][j] = P[i * NE + j] - PH[i] / S * PH[j];
  for (int i = 0; i < NE; ++i) {
    double row = 0.0;
    for (int l = 0; l < NE; ++l) row += left[i][l] * H[l];
    for (int j = 0; j < NE; ++j)
      spread[i * NE + j] =
          left[i][j] - row * (PH[j] / S) + PH[i] / S * (PH[j] / S) * noises[2] * noises[2];
  }
  for (int i = 0; i < NE; ++i)
    for (int j = 0; j < i; ++j)
      spread[i * NE + j] = spread[j * NE + i] = 0.5 * (spread[i * NE + j] + spread[j * NE + i]);
  if (!sound(moved, spread)) return 0;
  taken(moved, spread, x, P);
  return 1;
}

/* What a plan costs, twice: errors off of the reading and moves w of the drive, as the program has
   it. */
static double stage_cost(const double *weights, const double *bounds, double off, double y,
                         double w, int last) {
  const double passed = fmax(0.0, y - bounds[4]) + fmax(0.0, bounds[3] - y);
  return weights[0] * (last ? weights[2] : 1.0) * off * off + weights[1] * w * w +
         2.0 * weights[3] * passed;
}

/* The same of the moves w + share dw, by the model itself. */
static double plan_cost(long n, const double *p, double t, double T, const double *x0, double u,
                        long rise, long held, const double *r, const double *weights,
                        const double *bounds, const double *w, const double *dw, double share) {
  double x[NX + 1], y, cost = 0.0;
  for (int i = 0; i < NX; ++i) x[i] = x0[i];
  for (long k = 0; k < n; ++k) {
    const double move = w[k] + share * dw[k];
    period(p, t, u, 0, u + move, 0, T, rise, held, x, 0);
    u += move;
    t += T;
    reading(p, t, x, 0, u, 0, &y, 0);
    y += x0[NX];
    cost += stage_cost(weights, bounds, y - r[k], y, move, k == n - 1);
  }
  return cost;
}

/* One real-time iteration: the program's step, or half of it where the whole one makes the plan
   dearer by the law itself (by more than a hundredth: near the optimum rounding would choose) and
   half of it makes it cheaper: a loop's law has corners where the drive turns, and behind a corner
   the linearisation is another one. Where neither does, the whole step gets away from there. x: estimate at t, the disturbance last; pending: drives asked before
   that still wait (delay of them); r: references at the ends of the n periods that follow them;
   w: moves of last time, shifted by the caller. bounds: low, high, slew, lowest and highest
   reading, and for the first move its own low and high drive. told: iterations, gap, status
   (0 as it should be; 1 the program failed and the drive is held as far as limits let it). */
static double decide(long n, long most, const double *p, double t, double T, const double *x0, double u0,
               long delay, const double *pending, long rise, long held, const double *r,
               const double *weights, const double *bounds, double *w, double *work,
               double *told) {
  double *A = work, *B = A + n * NZ * NZ, *C = B + n * NZ, *y = C + n * NZ, *e = y + n,
         *q = e + n, *g = q + n, *limits = g + n, *dw = limits + n * SIDES, *rest = dw + n;
  double x[NE], end[NX + 1], u = u0, now = 0.0;
  for (int i = 0; i < NE; ++i) x[i] = x0[i];
  for (long k = 0; k < delay; ++k) {
    period(p, t, u, 0, pending[k], 0, T, rise, held, x, 0);
    u = pending[k];
    t += T;
  }
  const double low = bounds[0], high = bounds[1], most_move = bounds[2] * T;
  /* The moves of last time within the limits, from where the drive is. */
  double drive = u;
  for (long k = 0; k < n; ++k) {
    const double wanted = isfinite(w[k]) ? drive + w[k] : drive;
    const double least = k == 0 ? bounds[5] : fmin(fmax(drive - most_move, low), drive + most_move);
    const double largest =
        k == 0 ? bounds[6] : fmax(fmin(drive + most_move, high), drive - most_move);
    const double next = fmin(fmax(wanted, least), largest);
    w[k] = next - drive;
    drive = next;
  }
  linearise(n, p, t, T, x, u, rise, held, w, A, B, C, y, end);
  drive = u;
  for (long k = 0; k < n; ++k) {
    drive += w[k];
    const double off = y[k] + x[NX];
    double *limit = limits + k * SIDES;
    e[k] = r[k] - off;
    now += stage_cost(weights, bounds, e[k], off, w[k], k == n - 1);
    q[k] = weights[0];
    g[k] = weights[1] * w[k];
    dw[k] = 0.0;
    limit[0] = (k ? -most_move : fmax(bounds[5] - u, -1e30)) - w[k];
    limit[1] = (k ? most_move : fmin(bounds[6] - u, 1e30)) - w[k];
    /* Where the drive is out of its range it has the time that its slew rate takes. */
    limit[2] = fmin(low, u + (double)(k + 1) * most_move) - drive;
    limit[3] = fmax(high, u - (double)(k + 1) * most_move) - drive;
    limit[4] = bounds[3] - off;
    limit[5] = bounds[4] - off;
    for (int i = 0; i < SIDES; ++i)
      if (!(fabs(limit[i]) < HUGE_LIMIT)) limit[i] = i % 2 ? 1e30 : -1e30;
    for (int i = 0; i < 4; i += 2)
      if (limit[i + 1] - limit[i] < NARROW * (1.0 + fabs(limit[i]))) {
        limit[i] -= NARROW * (1.0 + fabs(limit[i]));
        limit[i + 1] += NARROW * (1.0 + fabs(limit[i + 1]));
      }
  }
  q[n - 1] *= weights[2];
  const Program m = {n, most, A, B, C, e, q, g, limits, weights[1], weights[3]};
  const long done = solve_program(&m, dw, rest, told + 1);
  told[0] = (double)done;
  told[2] = done < 0 ? 1.0 : 0.0;
  double share = 1.0, whole = 0.0;
  if (done >= 0) whole = plan_cost(n, p, t, T, x, u, rise, held, r, weights, bounds, w, dw, 1.0);
  if (!(whole <= 1.01 * now) &&
      !(plan_cost(n, p, t, T, x, u, rise, held, r, weights, bounds, w, dw, 0.5) > now))
    share = 0.5;
  for (long k = 0; k < n; ++k) w[k] = done < 0 || !isfinite(dw[k]) ? 0.0 : w[k] + share * dw[k];
  const double asked = u + w[0];
  const double kept = fmin(fmax(isfinite(asked) ? asked : u, bounds[5]), bounds[6]);
  w[0] = kept - u;
  return kept;
}
