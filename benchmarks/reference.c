/* The two time loops of seatrial in C: WIDTH lanes advance together and stay in registers over all samples.
 *
 * Surge: (m - X_udot) du/dt = X_u u + X_u|u| u|u| + (1 - t_d) T n|n|, classical Runge-Kutta, input held over a step.
 * The filter's state is (u, X_u, X_u|u|, T); it measures u and du/dt; alpha = 1, beta = 2, kappa = 0.
 */
#include <math.h>

#ifndef WIDTH
#define WIDTH 16
#endif
#define UNROLL _Pragma("GCC unroll 16")
#define INLINE static inline __attribute__((always_inline))

enum { STATES = 4, OUTPUTS = 2, POINTS = 2 * STATES + 1, JOINT = STATES + OUTPUTS };

typedef double lanes __attribute__((vector_size(8 * WIDTH)));
typedef long long bits __attribute__((vector_size(8 * WIDTH)));

INLINE lanes all(double x) { return x - (lanes){0}; }
INLINE lanes modulus(lanes x) { return (lanes)((bits)x & 0x7fffffffffffffff); }
INLINE lanes root(lanes x)
{
    lanes r;
    for (int l = 0; l < WIDTH; l++) r[l] = sqrt(x[l]);
    return r;
}

/* Log-likelihood of white residuals in u; params holds rows X_u, X_u|u|, T and sigma of n_lanes each. */
void surge_log_likelihood(long first, long last, long n_lanes, long samples, const double *params,
                          const double *control, const double *measured, double initial, double step,
                          double mass, double share, double *out)
{
    for (long start = first; start < last; start += WIDTH) {
        double linear[WIDTH], quadratic[WIDTH], thrust[WIDTH], u[WIDTH], squares[WIDTH];
        for (int l = 0; l < WIDTH; l++) {
            long lane = start + l < last ? start + l : last - 1;
            linear[l] = params[lane] / mass;
            quadratic[l] = params[n_lanes + lane] / mass;
            thrust[l] = params[2 * n_lanes + lane] * share / mass;
            u[l] = initial;
            squares[l] = 0;
        }
        for (long k = 0; k < samples; k++) {
            double drive = control[k] * fabs(control[k]), y = measured[k];
            for (int l = 0; l < WIDTH; l++) {
                double push = thrust[l] * drive, residual = y - u[l], v = u[l];
                double k1 = v * (linear[l] + quadratic[l] * fabs(v)) + push;
                v = u[l] + 0.5 * step * k1;
                double k2 = v * (linear[l] + quadratic[l] * fabs(v)) + push;
                v = u[l] + 0.5 * step * k2;
                double k3 = v * (linear[l] + quadratic[l] * fabs(v)) + push;
                v = u[l] + step * k3;
                double k4 = v * (linear[l] + quadratic[l] * fabs(v)) + push;
                squares[l] += residual * residual;
                u[l] += step / 6 * (k1 + 2 * (k2 + k3) + k4);
            }
        }
        for (int l = 0; l < WIDTH && start + l < last; l++) {
            double sd = params[3 * n_lanes + start + l];
            out[start + l] = -samples * (log(sd) + 0.5 * log(2 * M_PI)) - 0.5 * squares[l] / (sd * sd);
        }
    }
}

INLINE lanes rate(lanes u, lanes linear, lanes quadratic, lanes push)
{
    return u * (linear + quadratic * modulus(u)) + push;
}

INLINE lanes moved(lanes u, lanes linear, lanes quadratic, lanes push, double step)
{
    lanes k1 = rate(u, linear, quadratic, push);
    lanes k2 = rate(u + 0.5 * step * k1, linear, quadratic, push);
    lanes k3 = rate(u + 0.5 * step * k2, linear, quadratic, push);
    lanes k4 = rate(u + step * k3, linear, quadratic, push);
    return u + step / 6 * (k1 + 2 * (k2 + k3) + k4);
}

/* Lower factor of the sum of row^T row, by modified Gram-Schmidt; constant zeros cost nothing once unrolled. */
INLINE void triangularise(int n_rows, int n, lanes rows[n_rows][n], lanes factor[n][n])
{
    UNROLL for (int j = 0; j < n; j++) {
        lanes square = {0};
        UNROLL for (int r = 0; r < n_rows; r++) square += rows[r][j] * rows[r][j];
        factor[j][j] = root(square);
        lanes inverse = 1.0 / factor[j][j];
        UNROLL for (int r = 0; r < n_rows; r++) rows[r][j] *= inverse;
        UNROLL for (int k = j + 1; k < n; k++) {
            lanes projection = {0};
            UNROLL for (int r = 0; r < n_rows; r++) projection += rows[r][j] * rows[r][k];
            factor[k][j] = projection;
            UNROLL for (int r = 0; r < n_rows; r++) rows[r][k] -= projection * rows[r][j];
        }
    }
}

INLINE void sigma_points(const lanes mean[STATES], lanes factor[STATES][STATES], lanes point[POINTS][STATES])
{
    UNROLL for (int i = 0; i < STATES; i++) {
        point[0][i] = mean[i];
        UNROLL for (int j = 0; j < STATES; j++) {
            point[1 + j][i] = j <= i ? mean[i] + 2 * factor[i][j] : mean[i];
            point[1 + STATES + j][i] = j <= i ? mean[i] - 2 * factor[i][j] : mean[i];
        }
    }
}

/* Mean of the values at the sigma points, weighted differences and sums of the pairs, the centre behind the sums. */
INLINE lanes spread(const lanes value[POINTS], lanes difference[STATES], lanes sum[STATES + 1])
{
    lanes total = {0};
    UNROLL for (int p = 1; p < POINTS; p++) total += value[p] - value[0];
    lanes mean = value[0] + 0.125 * total;
    UNROLL for (int j = 0; j < STATES; j++) {
        difference[j] = 0.25 * (value[1 + j] - value[1 + STATES + j]);
        sum[j] = 0.25 * ((value[1 + j] - mean) + (value[1 + STATES + j] - mean));
    }
    sum[STATES] = M_SQRT2 * (value[0] - mean);
    return mean;
}

INLINE void update(lanes mean[STATES], lanes factor[STATES][STATES], const lanes measured[OUTPUTS], lanes drive,
                   double mass, const double *measurement_sd)
{
    lanes point[POINTS][STATES], value[POINTS], difference[STATES], sum[STATES + 1];
    lanes innovation[OUTPUTS], white[OUTPUTS];
    lanes rows[STATES + 1 + OUTPUTS][OUTPUTS] = {0}, packed[OUTPUTS][OUTPUTS];
    lanes joint[JOINT][JOINT] = {0}, after[JOINT][JOINT];
    sigma_points(mean, factor, point);
    UNROLL for (int m = 0; m < OUTPUTS; m++) {
        UNROLL for (int p = 0; p < POINTS; p++) {
            const lanes *x = point[p];
            value[p] = m == 0 ? x[0] : rate(x[0], x[1] / mass, x[2] / mass, x[3] * drive);
        }
        innovation[m] = measured[m] - spread(value, difference, sum);
        UNROLL for (int j = 0; j < STATES; j++) joint[j][m] = difference[j];
        UNROLL for (int j = 0; j <= STATES; j++) rows[j][m] = sum[j];
        rows[STATES + 1 + m][m] = all(measurement_sd[m]);
    }
    triangularise(STATES + 1 + OUTPUTS, OUTPUTS, rows, packed);
    UNROLL for (int m = 0; m < OUTPUTS; m++)
        UNROLL for (int i = m; i < OUTPUTS; i++) joint[STATES + m][i] = packed[i][m];
    UNROLL for (int j = 0; j < STATES; j++)
        UNROLL for (int i = j; i < STATES; i++) joint[j][OUTPUTS + i] = factor[i][j];
    triangularise(JOINT, JOINT, joint, after);
    white[0] = innovation[0] / after[0][0];
    white[1] = (innovation[1] - after[1][0] * white[0]) / after[1][1];
    UNROLL for (int i = 0; i < STATES; i++) {
        mean[i] += after[OUTPUTS + i][0] * white[0] + after[OUTPUTS + i][1] * white[1];
        UNROLL for (int j = 0; j <= i; j++) factor[i][j] = after[OUTPUTS + i][OUTPUTS + j];
    }
}

INLINE void predict(lanes mean[STATES], lanes factor[STATES][STATES], lanes drive, double mass, double step,
                    const double *process_sd)
{
    lanes point[POINTS][STATES], value[POINTS], difference[STATES], sum[STATES + 1];
    lanes rows[2 * STATES][STATES] = {0}, after[STATES][STATES], own = all(process_sd[0] * process_sd[0]);
    sigma_points(mean, factor, point);
    UNROLL for (int p = 0; p < POINTS; p++)
        value[p] = moved(point[p][0], point[p][1] / mass, point[p][2] / mass, point[p][3] * drive, step);
    mean[0] = spread(value, difference, sum);
    UNROLL for (int j = 0; j <= STATES; j++) own += sum[j] * sum[j];
    rows[STATES][0] = root(own);
    UNROLL for (int j = 1; j < STATES; j++) rows[STATES + j][j] = all(process_sd[j]);
    UNROLL for (int j = 0; j < STATES; j++) {
        rows[j][0] = difference[j];
        UNROLL for (int i = 1; i < STATES; i++) if (i >= j) rows[j][i] = factor[i][j];
    }
    triangularise(2 * STATES, STATES, rows, after);
    UNROLL for (int i = 0; i < STATES; i++)
        UNROLL for (int j = 0; j <= i; j++) factor[i][j] = after[i][j];
}

/* Square-root UKF over the noise-free motion; control holds rows of n_lanes for each sample, out the final factor. */
void filter_factors(long first, long last, long n_lanes, long samples, const double *control, const double *mean0,
                    const double *factor0, const double *process_sd, const double *measurement_sd, double step,
                    double mass, double share, double *out)
{
    for (long start = first; start < last; start += WIDTH) {
        lanes mean[STATES], factor[STATES][STATES] = {0}, u = all(mean0[0]), n = {0};
        lanes linear = all(mean0[1] / mass), quadratic = all(mean0[2] / mass);
        for (int i = 0; i < STATES; i++) {
            mean[i] = all(mean0[i]);
            for (int j = 0; j <= i; j++) factor[i][j] = all(factor0[STATES * i + j]);
        }
        for (long k = 0; k < samples; k++) {
            for (int l = 0; l < WIDTH; l++) n[l] = control[k * n_lanes + (start + l < last ? start + l : last - 1)];
            lanes drive = share / mass * n * modulus(n), push = mean0[3] * drive;
            lanes measured[OUTPUTS] = {u, rate(u, linear, quadratic, push)};
            update(mean, factor, measured, drive, mass, measurement_sd);
            if (k < samples - 1) predict(mean, factor, drive, mass, step, process_sd);
            u = moved(u, linear, quadratic, push, step);
        }
        for (int i = 0; i < STATES; i++)
            for (int j = 0; j <= i; j++)
                for (int l = 0; l < WIDTH && start + l < last; l++)
                    out[(STATES * i + j) * n_lanes + start + l] = factor[i][j][l];
    }
}
