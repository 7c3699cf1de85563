/* The thesis filters (eqs. 2.15 to 2.17, 4.17 to 4.20, 6.13 to 6.20) as a C programmer would write
 * them for speed: with a sparse Jacobian, the upper triangle of P in local variables, and one
 * scalar update for each measurement. tools/bench/filters.py compiles this file and compares with
 * it; nothing else uses it. SI units.
 */
#include <math.h>

struct parameters { /* in the order of PARAMETER_FIELDS in tools/bench/filters.py */
    double piston_area, moving_mass, stroke_min, stroke_max, line_volume_1, line_volume_2;
    double bulk_modulus, density, supply_pressure, return_pressure;
    double discharge_coefficient, area_gradient, valve_gain, valve_frequency, valve_damping;
    double stiction, coulomb, stribeck_velocity, viscous, stick_velocity;
};

struct entries { /* of A, if neither zero nor one; without the constant T in rows 0 and 3 */
    double a10, a11, a13, a14, a20, a22, a23, a24, a41, a42, a44, a46, a50, a55;
};

static const double T = 1e-3;
static const double pressure_drop_floor = 1.0;
static const double Q6[] = {1e-20, 1e4, 1e4, 1e-6, 1e-6, 1e-20}, R6[] = {1e-4, 1e6, 1e6};
static const double Q7[] = {1e-20, 1e4, 1e4, 1e-6, 1e-4, 1e-20, 1e2}, R7[] = {1e-4, 1e5, 1e5};
static const int measured[] = {3, 1, 2};

static inline double edge(double drop, double density, double *slope)
{
    const int open = drop > pressure_drop_floor;
    const double jet = sqrt(2.0 / density * (open ? drop : pressure_drop_floor));
    *slope = open ? 1.0 / (density * jet) : 0.0;
    return jet;
}

static inline double friction(double v, double force, const struct parameters *c, double *slope)
{
    const double speed = fabs(v);
    if (speed > c->stick_velocity) {
        const double excess = (c->stiction - c->coulomb) * exp(-speed / c->stribeck_velocity);
        *slope = c->viscous - excess / c->stribeck_velocity;
        return copysign(c->coulomb + excess, v) + c->viscous * v;
    }
    *slope = 0.0;
    return fabs(force) < c->stiction ? force : copysign(c->stiction, force);
}

/* Predicts the physical states over one interval, in place. Fills in the entries of A at the states
 * before; a44 and a46 are left to the caller. */
static inline void predict(double *x, double resistance, double u, const struct parameters *c,
                           struct entries *a)
{
    const double A = c->piston_area, gradient = c->discharge_coefficient * c->area_gradient;
    const double w = c->valve_frequency, damping = 2.0 * c->valve_damping * w;
    const double h1 = c->bulk_modulus / (c->line_volume_1 + A * (x[3] - c->stroke_min));
    const double h2 = c->bulk_modulus / (c->line_volume_2 + A * (c->stroke_max - x[3]));
    double jet1, jet2, slope1, slope2;
    if (x[0] > 0.0) {
        jet1 = edge(c->supply_pressure - x[1], c->density, &slope1);
        jet2 = edge(x[2] - c->return_pressure, c->density, &slope2);
        slope1 = -slope1;
    } else {
        jet1 = edge(x[1] - c->return_pressure, c->density, &slope1);
        jet2 = edge(c->supply_pressure - x[2], c->density, &slope2);
        slope2 = -slope2;
    }
    const double net1 = gradient * x[0] * jet1 - A * x[4];
    const double net2 = A * x[4] - gradient * x[0] * jet2;
    const double acceleration = (A * (x[1] - x[2]) - resistance) / c->moving_mass;
    const double spool_acceleration = w * w * (c->valve_gain * u - x[0]) - damping * x[5];
    a->a10 = T * h1 * gradient * jet1;
    a->a11 = 1.0 + T * h1 * gradient * x[0] * slope1;
    a->a13 = -T * h1 * h1 * (A / c->bulk_modulus) * net1;
    a->a14 = -T * h1 * A;
    a->a20 = -T * h2 * gradient * jet2;
    a->a22 = 1.0 - T * h2 * gradient * x[0] * slope2;
    a->a23 = T * h2 * h2 * (A / c->bulk_modulus) * net2;
    a->a24 = T * h2 * A;
    a->a41 = T * A / c->moving_mass;
    a->a42 = -a->a41;
    a->a50 = -T * w * w;
    a->a55 = 1.0 - T * damping;
    x[0] += T * x[5];
    x[1] += T * h1 * net1;
    x[2] += T * h2 * net2;
    x[3] += T * x[4];
    x[4] += T * acceleration;
    x[5] += T * spool_acceleration;
}

/* All loops over these local arrays are unrolled, so that the arrays are kept in registers. S(i, j)
 * is an entry of a symmetric matrix, of which s has the upper triangle. */
#define S(i, j) s[(i) < (j) ? (i) : (j)][(i) < (j) ? (j) : (i)]
#define EACH(i, from) _Pragma("GCC unroll 8") for (int i = (from); i < n; i++)

static inline __attribute__((always_inline)) void
kalman(const int n, double *x, double *restrict P, const struct entries a, const double *q,
       const double *r, const double *z, double *restrict out)
{
    double s[7][7], m[7][7], gain[7];

    EACH(i, 0) EACH(j, i) s[i][j] = P[i * n + j];
    EACH(k, 0) {
        m[0][k] = S(0, k) + T * S(5, k);
        m[1][k] = a.a10 * S(0, k) + a.a11 * S(1, k) + a.a13 * S(3, k) + a.a14 * S(4, k);
        m[2][k] = a.a20 * S(0, k) + a.a22 * S(2, k) + a.a23 * S(3, k) + a.a24 * S(4, k);
        m[3][k] = S(3, k) + T * S(4, k);
        m[4][k] = a.a41 * S(1, k) + a.a42 * S(2, k) + a.a44 * S(4, k);
        if (n > 6)
            m[4][k] += a.a46 * S(6, k);
        m[5][k] = a.a50 * S(0, k) + a.a55 * S(5, k);
        if (n > 6)
            m[6][k] = S(6, k);
    }
    /* For each pair of rows, the row with fewer entries is the right factor. */
    S(1, 1) = a.a10 * m[1][0] + a.a11 * m[1][1] + a.a13 * m[1][3] + a.a14 * m[1][4];
    S(1, 2) = a.a20 * m[1][0] + a.a22 * m[1][2] + a.a23 * m[1][3] + a.a24 * m[1][4];
    S(2, 2) = a.a20 * m[2][0] + a.a22 * m[2][2] + a.a23 * m[2][3] + a.a24 * m[2][4];
    EACH(i, 0) {
        if (i == 1 || i == 2 || i == 4) {
            S(i, 4) = a.a41 * m[i][1] + a.a42 * m[i][2] + a.a44 * m[i][4];
            if (n > 6)
                S(i, 4) += a.a46 * m[i][6];
        }
        if (i != 3 && i != 5 && i != 6)
            S(i, 0) = m[i][0] + T * m[i][5];
        if (i != 5 && i != 6)
            S(i, 3) = m[i][3] + T * m[i][4];
        if (i != 6)
            S(i, 5) = a.a50 * m[i][0] + a.a55 * m[i][5];
        if (n > 6)
            S(i, 6) = m[i][6];
    }
    S(0, 3) = m[0][3] + T * m[0][4];
    EACH(i, 0) s[i][i] += q[i];

    for (int k = 0; k < 3; k++) {
        out[k] = z[k] - x[measured[k]];
        out[k + 6] = isnan(z[k]) ? NAN : S(measured[k], measured[k]) + r[k];
    }
    _Pragma("GCC unroll 3") for (int k = 0; k < 3; k++) {
        const int h = measured[k];
        if (isnan(z[k]))
            continue;
        const double inverse = 1.0 / (S(h, h) + r[k]), deviation = (z[k] - x[h]) * inverse;
        EACH(i, 0) x[i] += S(i, h) * deviation;
        EACH(i, 0) gain[i] = S(i, h) * inverse;
        EACH(i, 0) EACH(j, i) {
            if (i != h && j != h)
                s[i][j] -= gain[i] * S(j, h);
        }
        EACH(i, 0) S(i, h) *= r[k] * inverse;
    }
    for (int k = 0; k < 3; k++)
        out[k + 3] = z[k] - x[measured[k]];
    EACH(i, 0) EACH(j, i) P[i * n + j] = P[j * n + i] = s[i][j];
}

void thesis6_run(long samples, double *restrict x, double *restrict P, const double *u,
                 const double *z, const struct parameters *c, double *restrict out)
{
    for (long t = 0; t < samples; t++) { /* each sample overwrites out */
        double y[7], slope;
        struct entries a;
        for (int i = 0; i < 6; i++)
            y[i] = x[i];
        const double force = c->piston_area * (y[1] - y[2]);
        const double resistance = friction(y[4], force, c, &slope);
        predict(y, resistance, u[t], c, &a);
        a.a44 = 1.0 - T / c->moving_mass * slope;
        kalman(6, y, P, a, Q6, R6, z + 3 * t, out);
        for (int i = 0; i < 6; i++)
            x[i] = y[i];
    }
}

void thesis7_run(long samples, double *restrict x, double *restrict P, const double *u,
                 const double *z, const struct parameters *c, double *restrict out)
{
    for (long t = 0; t < samples; t++) {
        double y[7];
        struct entries a;
        for (int i = 0; i < 7; i++)
            y[i] = x[i];
        predict(y, y[6], u[t], c, &a);
        a.a44 = 1.0;
        a.a46 = -T / c->moving_mass;
        kalman(7, y, P, a, Q7, R7, z + 3 * t, out);
        for (int i = 0; i < 7; i++)
            x[i] = y[i];
    }
}
