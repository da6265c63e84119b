/* Adaptive Metropolis over the surge posterior in scalar C: one chain, one trajectory at a time, no libraries.
 *
 * Parameters are X_u, X_u|u|, T and sigma, uniform in a box. During warm-up the proposal's covariance follows the chain's
 * and its scale the acceptance (Haario, Saksman and Tamminen, 2001); both are frozen for the draws that are kept.
 */
#include <math.h>

enum { DIM = 4 };

typedef struct { unsigned long long word; double spare; int has_spare; } source;

double chain_log_likelihood(const double *params, long samples, const double *control, const double *measured,
                            double initial, double step, double mass, double share)
{
    double linear = params[0] / mass, quadratic = params[1] / mass, thrust = params[2] * share / mass, sd = params[3];
    double u = initial, squares = 0;
    for (long k = 0; k < samples; k++) {
        double push = thrust * control[k] * fabs(control[k]), residual = measured[k] - u;
        double k1 = u * (linear + quadratic * fabs(u)) + push;
        double v = u + 0.5 * step * k1;
        double k2 = v * (linear + quadratic * fabs(v)) + push;
        v = u + 0.5 * step * k2;
        double k3 = v * (linear + quadratic * fabs(v)) + push;
        v = u + step * k3;
        double k4 = v * (linear + quadratic * fabs(v)) + push;
        squares += residual * residual;
        u += step / 6 * (k1 + 2 * (k2 + k3) + k4);
    }
    return -samples * (log(sd) + 0.5 * log(2 * M_PI)) - 0.5 * squares / (sd * sd);
}

/* Marsaglia's xorshift64*, in (0, 1). */
static double uniform(source *random)
{
    random->word ^= random->word >> 12;
    random->word ^= random->word << 25;
    random->word ^= random->word >> 27;
    return ((random->word * 0x2545f4914f6cdd1dull >> 11) + 0.5) * 0x1p-53;
}

/* Box-Muller, two at a time. */
static double normal(source *random)
{
    random->has_spare = !random->has_spare;
    if (!random->has_spare) return random->spare;
    double radius = sqrt(-2 * log(uniform(random))), angle = 2 * M_PI * uniform(random);
    random->spare = radius * sin(angle);
    return radius * cos(angle);
}

static void cholesky(double cov[DIM][DIM], double factor[DIM][DIM])
{
    for (int j = 0; j < DIM; j++)
        for (int i = j; i < DIM; i++) {
            double sum = i == j ? cov[i][i] * (1 + 1e-12) : cov[i][j];
            for (int k = 0; k < j; k++) sum -= factor[i][k] * factor[j][k];
            factor[i][j] = i == j ? sqrt(sum) : sum / factor[j][j];
        }
}

/* Rows of draws after warm-up; start inside the box, cov the first proposal covariance before scaling. */
void chain(long warmup, long draws, long seed, const double *start, const double *first_cov, const double *lower,
           const double *upper, long samples, const double *control, const double *measured, double initial, double step,
           double mass, double share, double *out)
{
    source random = {0x9e3779b97f4a7c15ull * (seed + 1), 0, 0};
    double at[DIM], mean[DIM], cov[DIM][DIM], factor[DIM][DIM], log_scale = log(2.38 / sqrt(DIM));
    for (int i = 0; i < DIM; i++) {
        at[i] = mean[i] = start[i];
        for (int j = 0; j < DIM; j++) cov[i][j] = first_cov[DIM * i + j];
    }
    double density = chain_log_likelihood(at, samples, control, measured, initial, step, mass, share);
    cholesky(cov, factor);
    for (long t = 0; t < warmup + draws; t++) {
        double proposal[DIM], noise[DIM], acceptance = 0;
        int inside = 1;
        for (int i = 0; i < DIM; i++) {
            noise[i] = normal(&random);
            proposal[i] = at[i];
            for (int j = 0; j <= i; j++) proposal[i] += exp(log_scale) * factor[i][j] * noise[j];
            inside &= lower[i] < proposal[i] && proposal[i] < upper[i];
        }
        if (inside) {
            double change =
                chain_log_likelihood(proposal, samples, control, measured, initial, step, mass, share) - density;
            acceptance = exp(fmin(0, change));
            if (uniform(&random) < acceptance) {
                density += change;
                for (int i = 0; i < DIM; i++) at[i] = proposal[i];
            }
        }
        if (t < warmup) {
            double weight = 2.0 / (t + 100);
            for (int i = 0; i < DIM; i++) mean[i] += weight * (at[i] - mean[i]);
            for (int i = 0; i < DIM; i++)
                for (int j = 0; j < DIM; j++)
                    cov[i][j] += weight * ((at[i] - mean[i]) * (at[j] - mean[j]) - cov[i][j]);
            log_scale += pow(t + 1, -0.6) * (acceptance - 0.234);
            cholesky(cov, factor);
        } else {
            for (int i = 0; i < DIM; i++) out[DIM * (t - warmup) + i] = at[i];
        }
    }
}
