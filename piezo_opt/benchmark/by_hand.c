/* Gain, Bouc-Wen (n = 1), second order and offset, as somebody writes them who knows C and this one
 * model: the classical Runge-Kutta scheme, M sub-steps a sample, the drive U straight in between.
 *
 *     h' = alpha u' - beta |u'| h - gamma u' |h|
 *     x'' = omega^2 (d u - h - x) - 2 zeta omega x',      y = x + y0
 *
 * P: d, alpha, beta, gamma, omega, zeta, y0. Y takes the readings; po_run_moved also writes their
 * derivatives by P, seven to a reading, to J. Eight directions are two registers of four numbers.
 */
#include <math.h>

void po_run(const long count, const int m, const double step, const double *restrict U,
            const double *restrict P, double *restrict Y)
{
    const double d = P[0], alpha = P[1], beta = P[2], gamma = P[3];
    const double w2 = P[4] * P[4], c = 2.0 * P[5] * P[4], y0 = P[6];
    const double dt = step / m, half = 0.5 * dt, sixth = dt / 6.0;
    double h = 0.0, x = d * U[0], v = 0.0;
    Y[0] = x + y0;
    for (long k = 1; k < count; ++k) {
        const double du = (U[k] - U[k - 1]) / step;
        const double a = alpha * du, b = beta * fabs(du), g = gamma * du;
        double u = U[k - 1];
        for (int i = 0; i < m; ++i) {
            const double um = u + half * du, ue = u + dt * du;
            const double h1 = a - b * h - g * fabs(h);
            const double x1 = v, v1 = w2 * (d * u - h - x) - c * v;
            const double ha = h + half * h1, xa = x + half * x1, va = v + half * v1;
            const double h2 = a - b * ha - g * fabs(ha);
            const double x2 = va, v2 = w2 * (d * um - ha - xa) - c * va;
            const double hb = h + half * h2, xb = x + half * x2, vb = v + half * v2;
            const double h3 = a - b * hb - g * fabs(hb);
            const double x3 = vb, v3 = w2 * (d * um - hb - xb) - c * vb;
            const double hc = h + dt * h3, xc = x + dt * x3, vc = v + dt * v3;
            const double h4 = a - b * hc - g * fabs(hc);
            const double x4 = vc, v4 = w2 * (d * ue - hc - xc) - c * vc;
            h += sixth * (h1 + 2.0 * (h2 + h3) + h4);
            x += sixth * (x1 + 2.0 * (x2 + x3) + x4);
            v += sixth * (v1 + 2.0 * (v2 + v3) + v4);
            u = ue;
        }
        Y[k] = x + y0;
    }
}

typedef double four __attribute__((vector_size(32), aligned(8)));

/* Values and derivatives of the three states; those of h by alpha, beta and gamma alone. */
typedef struct { double h, x, v; four H, X[2], V[2]; } state;

static inline __attribute__((always_inline)) state rate(const state s, const double u,
                                                        const double du, const double *const P)
{
    const double size = fabs(du), w = P[4], w2 = w * w, c = 2.0 * P[5] * w;
    const double loop = P[2] * size + P[3] * (s.h < 0.0 ? -du : du), force = P[0] * u - s.h - s.x;
    state r;
    r.h = P[1] * du - P[2] * size * s.h - P[3] * du * fabs(s.h);
    r.x = s.v;
    r.v = w2 * force - c * s.v;
    r.H = (four){0.0, du, -size * s.h, -du * fabs(s.h)} - loop * s.H;
    r.X[0] = s.V[0], r.X[1] = s.V[1];
    r.V[0] = (four){w2 * u, 0.0, 0.0, 0.0} - w2 * (s.H + s.X[0]) - c * s.V[0];
    r.V[1] = (four){2.0 * w * force - 2.0 * P[5] * s.v, -2.0 * w * s.v, 0.0, 0.0}
        - w2 * s.X[1] - c * s.V[1];
    return r;
}

static inline __attribute__((always_inline)) state moved(const state s, const double by,
                                                         const state r)
{
    return (state){
        s.h + by * r.h, s.x + by * r.x, s.v + by * r.v, s.H + by * r.H,
        {s.X[0] + by * r.X[0], s.X[1] + by * r.X[1]}, {s.V[0] + by * r.V[0], s.V[1] + by * r.V[1]},
    };
}

void po_run_moved(const long count, const int m, const double step, const double *restrict U,
                  const double *restrict P, double *restrict Y, double *restrict J)
{
    const double dt = step / m, half = 0.5 * dt;
    state s = {0.0, P[0] * U[0], 0.0, {0}, {{U[0], 0.0, 0.0, 0.0}, {0}}, {{0}, {0}}};
    for (long k = 0; k < count; ++k) {
        if (k > 0) {
            const double du = (U[k] - U[k - 1]) / step;
            double u = U[k - 1];
            for (int i = 0; i < m; ++i) {
                const state r1 = rate(s, u, du, P);
                const state r2 = rate(moved(s, half, r1), u + half * du, du, P);
                const state r3 = rate(moved(s, half, r2), u + half * du, du, P);
                const state r4 = rate(moved(s, dt, r3), u + dt * du, du, P);
                s = moved(s, dt / 6.0, moved(moved(moved(r1, 2.0, r2), 2.0, r3), 1.0, r4));
                u += dt * du;
            }
        }
        Y[k] = s.x + P[6];
        *(four *)(J + 7 * k) = s.X[0];
        J[7 * k + 4] = s.X[1][0];
        J[7 * k + 5] = s.X[1][1];
        J[7 * k + 6] = 1.0;
    }
}
