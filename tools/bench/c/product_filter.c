/* The product filter (estimator/filters/product.py) as a C programmer would write it for speed. The
 * covariance is kept as factors U and D, with a column of U in each row of the array and D on the
 * diagonal; sizes are fixed, so that the compiler can unroll the loops. tools/bench/filters.py
 * compiles this file and compares with it; nothing else uses it. SI units.
 */
#include <math.h>
#include <string.h>

#define N 11
#define M 6  /* the first M states are those that the prediction changes */
#define W 10 /* number of columns to orthogonalise */
#define UNROLL _Pragma("GCC unroll 16")

struct constants { /* filled by c_constants in tools/bench/product.py, in the same order */
    double area, mass, stroke_min, stroke_max, line_volume_1, line_volume_2, bulk_modulus, density;
    double supply, back, discharge, gradient, valve_gain, valve_frequency, valve_damping, air;
    double r_position, r_pressure, r_spool;
    double q_spool_velocity, q_pressure, q_velocity, q_load, q_leakage, q_null;
    double position_min, position_max, pressure_min, pressure_max, spool, opening, velocity, load;
    double leakage, negative_leakage, null_bias;
};

struct watch {
    double squares, readings, ticks, resets, patience, supply;
};

static const double h = 0.5e-3, root_width = 1e4, dry = 1e5;

static inline double root(double drop, double *slope)
{
    if (fabs(drop) < root_width) {
        const double ratio = drop / root_width, scale = 0.25 / sqrt(root_width);
        *slope = scale * (5.0 - 3.0 * ratio * ratio);
        return scale * drop * (5.0 - ratio * ratio);
    }
    const double value = sqrt(fabs(drop));
    *slope = 0.5 / value;
    return copysign(value, drop);
}

static inline double softening(double p, const struct constants *c, double *slope)
{
    *slope = 0.0;
    if (c->air == 0.0)
        return 1.0;
    const double absolute = fmax(p, 0.0) + 101325.0, bubbles = c->air * 101325.0;
    const double liquid = (1.0 - c->air) * absolute;
    const double above = liquid + bubbles, below = absolute * liquid + c->bulk_modulus * bubbles;
    if (p > 0.0)
        *slope = 1.0 / absolute + (1.0 - c->air) / above - 2.0 * liquid / below;
    return absolute * above / below;
}

static void valve_step(const struct constants *c, double *a)
{
    const double w = c->valve_frequency, z = c->valve_damping, decay = exp(-z * w * h);
    const double square = 1.0 - z * z, angle = w * h * sqrt(fabs(square));
    double cosine = decay, sine = decay * h;
    if (square > 0.0) {
        cosine *= cos(angle);
        sine *= sin(angle) / angle;
    } else if (square < 0.0) {
        cosine *= cosh(angle);
        sine *= sinh(angle) / angle;
    }
    a[0] = cosine + z * w * sine;
    a[1] = sine;
    a[2] = -w * w * sine;
    a[3] = cosine - z * w * sine;
}

static inline void predict(double *x, double u, double supply, const struct constants *c,
                           double J[M][N])
{
    double a[4];
    valve_step(c, a);
    const double steady = c->valve_gain * u, A = c->area, back = c->back;
    const double conductance = c->discharge * c->gradient * sqrt(2.0 / c->density);
    double s = x[0], p1 = x[1], p2 = x[2], y = x[3], v = x[4], w = x[5];
    const double load = x[6], k1 = x[7], k2 = x[8], k12 = x[9], bias = x[10];
    double s0 = 1.0, s5 = 0.0, w0 = 0.0, w5 = 1.0;

    memset(J, 0, sizeof(double) * M * N);
    for (int i = 1; i < 5; i++)
        J[i][i] = 1.0;
    double kick = 0.5 * h / c->mass;
    v += kick * (A * (p1 - p2) - load);
    J[4][1] = kick * A;
    J[4][2] = -kick * A;
    J[4][6] = -kick;
    for (int sub = 0; sub < 2; sub++) {
        const double d = s - steady;
        double o = 0.5 * s + bias, o0 = 0.5 * s0, o5 = 0.5 * s5, t;
        s = steady + a[0] * d + a[1] * w;
        w = a[2] * d + a[3] * w;
        t = a[0] * s0 + a[1] * w0, w0 = a[2] * s0 + a[3] * w0, s0 = t;
        t = a[0] * s5 + a[1] * w5, w5 = a[2] * s5 + a[3] * w5, s5 = t;
        o += 0.5 * s, o0 += 0.5 * s0, o5 += 0.5 * s5;

        const double middle = y + 0.5 * h * v;
        const double v1 = c->line_volume_1 + A * (middle - c->stroke_min);
        const double v2 = c->line_volume_2 + A * (c->stroke_max - middle);
        y += h * v;
        double b1, b2;
        const double c1 = h * c->bulk_modulus * softening(p1, c, &b1) / v1;
        const double c2 = h * c->bulk_modulus * softening(p2, c, &b2) / v2;
        double m1, m2, m12, n1, n2;
        const double e1 = root(p1 - back, &m1), e2 = root(p2 - back, &m2);
        const double e12 = root(p1 - p2, &m12);
        double r1, r2;
        if (o >= 0.0) {
            r1 = root(supply - p1, &n1), n1 = -n1;
            r2 = e2, n2 = m2;
        } else {
            r1 = e1, n1 = m1;
            r2 = root(supply - p2, &n2), n2 = -n2;
        }
        const double flow = conductance * o;
        const double d1 = c1 * (flow * r1 - A * v - k1 * e1 - k12 * e12);
        const double d2 = c2 * (A * v - flow * r2 - k2 * e2 + k12 * e12);
        const double a11 = 1.0 + c1 * (flow * n1 - k1 * m1 - k12 * m12) + d1 * b1;
        const double a22 = 1.0 - c2 * (flow * n2 + k2 * m2 + k12 * m12) + d2 * b2;
        const double a12 = c1 * k12 * m12, a21 = c2 * k12 * m12;
        const double x1 = -d1 * A / v1, x2 = d2 * A / v2;
        const double u1 = 0.5 * h * x1 - c1 * A, u2 = 0.5 * h * x2 + c2 * A;
        UNROLL for (int j = 0; j < N; j++) {
            const double j1 = J[1][j], j2 = J[2][j], jx = J[3][j], jv = J[4][j];
            J[1][j] = a11 * j1 + a12 * j2 + x1 * jx + u1 * jv;
            J[2][j] = a21 * j1 + a22 * j2 + x2 * jx + u2 * jv;
            J[3][j] = jx + h * jv;
        }
        const double g1 = c1 * conductance * r1, g2 = c2 * conductance * r2;
        J[1][0] += g1 * o0, J[1][5] += g1 * o5, J[1][7] -= c1 * e1, J[1][9] -= c1 * e12;
        J[2][0] -= g2 * o0, J[2][5] -= g2 * o5, J[2][8] -= c2 * e2, J[2][9] += c2 * e12;
        J[1][10] += g1, J[2][10] -= g2;
        p1 += d1, p2 += d2;

        kick = (sub ? 0.5 * h : h) / c->mass;
        v += kick * (A * (p1 - p2) - load);
        UNROLL for (int j = 0; j < N; j++)
            J[4][j] += kick * A * (J[1][j] - J[2][j]);
        J[4][6] -= kick;
    }
    J[0][0] = s0, J[0][5] = s5, J[5][0] = w0, J[5][5] = w5;
    x[0] = s, x[1] = p1, x[2] = p2, x[3] = y, x[4] = v, x[5] = w;
}

static inline void rank_one(double U[N][N], int size, double *restrict a, double weight)
{
    for (int k = size - 1; k >= 0; k--) {
        const double d = U[k][k], raised = d + weight * a[k] * a[k];
        if (raised > 0.0) {
            const double inverse = 1.0 / raised, share = weight * a[k] * inverse, ak = a[k];
            weight *= d * inverse;
            U[k][k] = raised;
            for (int i = 0; i < k; i++) {
                const double u = U[k][i];
                a[i] -= ak * u;
                U[k][i] = u + share * a[i];
            }
        }
    }
}

static inline void noise(double U[N][N], int index, double variance)
{
    double a[N];
    const double d = U[index][index], raised = d + variance;
    if (raised > 0.0) {
        const double kept = d / raised;
        U[index][index] = raised;
        for (int i = 0; i < index; i++) {
            a[i] = U[index][i];
            U[index][i] *= kept;
        }
        rank_one(U, index, a, variance * kept);
    }
}

static inline void propagate(double U[N][N], double J[M][N], const struct constants *c)
{
    double rows[M][W] = {{0}}, weights[W];
    UNROLL for (int j = 0; j < N; j++) {
        double s[5];
        UNROLL for (int i = 1; i < 5; i++)
            s[i] = J[i][j];
        for (int k = 0; k < j; k++)
            UNROLL for (int i = 1; i < 5; i++)
                s[i] += J[i][k] * U[j][k];
        const double a = j > 0 ? U[j][0] : 1.0, b = j > 5 ? U[j][5] : (j == 5 ? 1.0 : 0.0);
        const double s0 = J[0][0] * a + J[0][5] * b, s5 = J[5][0] * a + J[5][5] * b;
        if (j < M) {
            weights[j] = U[j][j];
            rows[0][j] = s0, rows[5][j] = s5;
            UNROLL for (int i = 1; i < 5; i++)
                rows[i][j] = s[i];
        } else {
            U[j][0] = s0, U[j][5] = s5;
            UNROLL for (int i = 1; i < 5; i++)
                U[j][i] = s[i];
        }
    }
    rows[1][6] = rows[2][7] = rows[4][8] = rows[5][9] = 1.0;
    weights[6] = weights[7] = c->q_pressure;
    weights[8] = c->q_velocity, weights[9] = c->q_spool_velocity;
    UNROLL for (int j = M - 1; j >= 0; j--) {
        double total = 0.0, weighted[W];
        UNROLL for (int k = 0; k < W; k++) {
            weighted[k] = rows[j][k] * weights[k];
            total += weighted[k] * rows[j][k];
        }
        U[j][j] = total;
        const double inverse = total > 0.0 ? 1.0 / total : 0.0;
        UNROLL for (int i = 0; i < j; i++) {
            double product = 0.0;
            UNROLL for (int k = 0; k < W; k++)
                product += rows[i][k] * weighted[k];
            const double u = product * inverse;
            U[j][i] = u;
            UNROLL for (int k = 0; k < W; k++)
                rows[i][k] -= u * rows[j][k];
        }
    }
    noise(U, 6, c->q_load);
    noise(U, 7, c->q_leakage);
    noise(U, 8, c->q_leakage);
    noise(U, 9, c->q_leakage);
    noise(U, 10, c->q_null);
}

static inline double variance_of(double U[N][N], int index)
{
    double total = U[index][index];
    for (int j = index + 1; j < N; j++)
        total += U[j][index] * U[j][index] * U[j][j];
    return total;
}

static inline double correct(double *restrict x, double U[N][N], int index, double z, double r)
{
    double gain[N] = {0}, expected = r, inverse = 1.0 / r;
    for (int j = index; j < N; j++) {
        const double f = j == index ? 1.0 : U[j][index], d = U[j][j], g = d * f;
        const double slope = -f * inverse, before = expected;
        expected += f * g;
        inverse = 1.0 / expected;
        U[j][j] = d * before * inverse;
        for (int i = 0; i < j; i++) {
            const double u = U[j][i];
            U[j][i] = u + slope * gain[i];
            gain[i] += g * u;
        }
        gain[j] = g;
    }
    const double innovation = z - x[index], step = innovation * inverse;
    UNROLL for (int i = 0; i < N; i++)
        x[i] += gain[i] * step;
    return innovation * step;
}

static inline void forget(double U[N][N], int index, double variance)
{
    double a[N];
    const double weight = U[index][index];
    for (int i = 0; i < index; i++) {
        a[i] = U[index][i];
        U[index][i] = 0.0;
    }
    U[index][index] = variance;
    for (int j = index + 1; j < N; j++)
        U[j][index] = 0.0;
    rank_one(U, index, a, weight);
}

static inline double between(double z, double low, double high)
{
    return z > low && z < high ? z : NAN;
}

static inline double kept(double value, double bound)
{
    return fmin(fmax(value, -bound), bound);
}

static inline void take(struct watch *w, double square)
{
    w->squares += fmin(square, 100.0);
    w->readings += 1.0;
}

/* Returns whether the filter is lost. It is not started anew; the run ends there. */
static inline int judge(struct watch *w, const double *x, double U[N][N], const struct constants *c)
{
    double total = 0.0;
    for (int i = 0; i < N; i++)
        total += fabs(x[i]) + U[i][i];
    if (!isfinite(total))
        return 1;
    w->ticks += 1.0;
    if (w->ticks < 500.0)
        return 0;
    const double spread = 2.0 / (9.0 * w->readings), q = 1.0 - spread + 6.0 * sqrt(spread);
    const int lost = w->squares > 9.0 * w->readings * q * q * q || fabs(x[10]) >= c->null_bias ||
                     fmin(x[7], fmin(x[8], x[9])) <= -c->negative_leakage;
    w->squares = w->readings = w->ticks = 0.0;
    return lost;
}

static inline int step(double *restrict x, double U[N][N], double u, const double *z,
                       const struct constants *c, struct watch *w, double *restrict out)
{
    double J[M][N];
    const double position = between(z[0], c->position_min, c->position_max);
    const double p[] = {between(z[1], c->pressure_min, c->pressure_max),
                        between(z[2], c->pressure_min, c->pressure_max)};
    const double spool = between(z[3], -c->spool, c->spool);
    if (z[4] > c->pressure_min && z[4] < c->pressure_max)
        w->supply = z[4];
    predict(x, u, w->supply, c, J);
    propagate(U, J, c);
    out[0] = position - x[3], out[1] = p[0] - x[1], out[2] = p[1] - x[2];
    out[6] = variance_of(U, 3) + c->r_position;
    out[7] = variance_of(U, 1) + c->r_pressure;
    out[8] = variance_of(U, 2) + c->r_pressure;
    if (!isnan(spool))
        take(w, correct(x, U, 0, spool, c->r_spool));
    if (!isnan(position))
        take(w, correct(x, U, 3, position, c->r_position));
    for (int i = 0; i < 2; i++) {
        if (p[i] < dry) {
            x[1 + i] = p[i];
            forget(U, 1 + i, c->r_pressure);
        } else if (!isnan(p[i]))
            take(w, correct(x, U, 1 + i, p[i], c->r_pressure));
    }
    if (judge(w, x, U, c))
        return 0;
    x[0] = kept(x[0], c->opening), x[4] = kept(x[4], 2.0 * c->velocity);
    x[1] = kept(x[1], 2.0 * c->pressure_max), x[2] = kept(x[2], 2.0 * c->pressure_max);
    x[3] = fmin(fmax(x[3], c->position_min), c->position_max);
    x[6] = kept(x[6], 4.0 * c->load), x[10] = kept(x[10], c->opening);
    for (int i = 7; i < 10; i++)
        x[i] = kept(x[i], c->leakage);
    out[3] = position - x[3], out[4] = p[0] - x[1], out[5] = p[1] - x[2], out[9] = w->resets;
    return 1;
}

/* Runs the filter over a record; returns the number of samples until its end, or until the filter
 * is lost. `out` (10,) receives the outputs of the last sample. */
long product_run(long samples, double *restrict x, double *restrict factors, const double *u,
                 const double *z, const struct constants *c, double *restrict out)
{
    struct watch w = {0.0, 0.0, 0.0, 0.0, 0.0, c->supply};
    for (long t = 0; t < samples; t++)
        if (!step(x, (double(*)[N])factors, u[t], z + 5 * t, c, &w, out))
            return t;
    return samples;
}
