/* The REMUS 100 in six degrees of freedom in C (Prestero, 2001): WIDTH lanes advance together over all samples.
 *
 * State: velocity, position, quaternion. Classical Runge-Kutta, fins held over a step; every lane has its own coefficients, in the
 * order of the catalogue's table; the inverse of the mass matrix, two blocks of three, is given.
 */
#ifndef WIDTH
#define WIDTH 8
#endif
#define INLINE static inline __attribute__((always_inline))
#define EACH(i, n) _Pragma("GCC unroll 16") for (int i = 0; i < n; i++)

enum { STATES = 13, COEFFICIENTS = 24 };
enum { X0, XUU, YVV, YRR, YUV, YUR, YDR, ZWW, ZQQ, ZUW, ZUQ, ZDS, K0, KPP, MWW, MQQ, MUW, MUQ, MDS, NVV, NRR, NUV, NUR, NDR };

typedef double lanes __attribute__((vector_size(8 * WIDTH)));
typedef long long bits __attribute__((vector_size(8 * WIDTH)));

INLINE lanes all(double x) { return x - (lanes){0}; }
INLINE lanes signed_square(lanes x) { return x * (lanes)((bits)x & 0x7fffffffffffffff); }

static const double m = 30.48, W = 299.0, B = 306.0, zg = 0.0196, Ixx = 0.177, Iyy = 3.45, Izz = 3.45;
static const double Yvd = -35.5, Yrd = 1.93, Zwd = -35.5, Zqd = -1.93, Mrp = 4.86, Npq = -4.86;

INLINE void rate(const lanes *s, const lanes *c, double dr, double ds, const double *inverse, lanes *d)
{
    lanes u = s[0], v = s[1], w = s[2], p = s[3], q = s[4], r = s[5], e0 = s[9], e1 = s[10], e2 = s[11], e3 = s[12];
    lanes gx = 2 * (e1 * e3 - e0 * e2), gy = 2 * (e2 * e3 + e0 * e1), gz = 1 - 2 * (e1 * e1 + e2 * e2), uu = u * u;
    lanes X = (W - B) * gx + c[X0] + c[XUU] * signed_square(u) + (Zwd - m) * w * q + Zqd * q * q + (m - Yvd) * v * r
              - Yrd * r * r - m * zg * p * r;
    lanes Y = (W - B) * gy + c[YVV] * signed_square(v) + c[YRR] * signed_square(r) + c[YUV] * u * v + (m - Zwd) * w * p
              + (c[YUR] - m) * u * r - m * zg * q * r - Zqd * p * q + c[YDR] * uu * dr;
    lanes Z = (W - B) * gz + c[ZWW] * signed_square(w) + c[ZQQ] * signed_square(q) + c[ZUW] * u * w + (c[ZUQ] + m) * u * q
              + (Yvd - m) * v * p + m * zg * (p * p + q * q) + Yrd * r * p + c[ZDS] * uu * ds;
    lanes K = -zg * W * gy + c[K0] + c[KPP] * signed_square(p) - (Izz - Iyy) * q * r - m * zg * (w * p - u * r);
    lanes M = zg * W * gx + c[MWW] * signed_square(w) + c[MQQ] * signed_square(q) + (Mrp - Ixx + Izz) * r * p
              + m * zg * (v * r - w * q) + c[MUQ] * u * q + c[MUW] * u * w - Yrd * v * p + c[MDS] * uu * ds;
    lanes N = c[NVV] * signed_square(v) + c[NRR] * signed_square(r) + c[NUV] * u * v + (Npq - Iyy + Ixx) * p * q
              + Zqd * w * p + c[NUR] * u * r + c[NDR] * uu * dr;
    d[0] = inverse[0] * X + inverse[1] * Z + inverse[2] * M;
    d[2] = inverse[3] * X + inverse[4] * Z + inverse[5] * M;
    d[4] = inverse[6] * X + inverse[7] * Z + inverse[8] * M;
    d[1] = inverse[9] * Y + inverse[10] * K + inverse[11] * N;
    d[3] = inverse[12] * Y + inverse[13] * K + inverse[14] * N;
    d[5] = inverse[15] * Y + inverse[16] * K + inverse[17] * N;
    d[6] = (1 - 2 * (e2 * e2 + e3 * e3)) * u + 2 * (e1 * e2 - e0 * e3) * v + 2 * (e1 * e3 + e0 * e2) * w;
    d[7] = 2 * (e1 * e2 + e0 * e3) * u + (1 - 2 * (e1 * e1 + e3 * e3)) * v + 2 * (e2 * e3 - e0 * e1) * w;
    d[8] = gx * u + gy * v + gz * w;
    lanes pull = 1 - (e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3);
    d[9] = pull * e0 - 0.5 * (p * e1 + q * e2 + r * e3);
    d[10] = pull * e1 + 0.5 * (p * e0 + r * e2 - q * e3);
    d[11] = pull * e2 + 0.5 * (q * e0 + p * e3 - r * e1);
    d[12] = pull * e3 + 0.5 * (r * e0 + q * e1 - p * e2);
}

/* States after all samples, rows of n_lanes each; params holds a row of n_lanes for each coefficient. */
void whole_final(long first, long last, long n_lanes, long samples, const double *params, const double *rudder,
                 const double *plane, const double *start, double step, const double *inverse, double *out)
{
    for (long block = first; block < last; block += WIDTH) {
        lanes c[COEFFICIENTS], s[STATES], at[STATES], d[STATES], sum[STATES];
        EACH(l, WIDTH) {
            long lane = block + l < last ? block + l : last - 1;
            for (int i = 0; i < COEFFICIENTS; i++) c[i][l] = params[i * n_lanes + lane];
        }
        EACH(i, STATES) s[i] = all(start[i]);
        for (long k = 0; k < samples; k++) {
            double dr = rudder[k], ds = plane[k];
            rate(s, c, dr, ds, inverse, d);
            EACH(i, STATES) { sum[i] = d[i]; at[i] = s[i] + 0.5 * step * d[i]; }
            rate(at, c, dr, ds, inverse, d);
            EACH(i, STATES) { sum[i] += 2 * d[i]; at[i] = s[i] + 0.5 * step * d[i]; }
            rate(at, c, dr, ds, inverse, d);
            EACH(i, STATES) { sum[i] += 2 * d[i]; at[i] = s[i] + step * d[i]; }
            rate(at, c, dr, ds, inverse, d);
            EACH(i, STATES) s[i] += step / 6 * (sum[i] + d[i]);
        }
        for (int l = 0; l < WIDTH && block + l < last; l++)
            for (int i = 0; i < STATES; i++) out[i * n_lanes + block + l] = s[i][l];
    }
}
