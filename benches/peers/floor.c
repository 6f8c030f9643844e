// What one AVX-512 core allows: mean and variance of a prediction, hand-written, sizes known to the
// compiler, eight rows of the inverse factor to a register.
//   cc -O3 -march=native floor.c -o floor -lm && ./floor
#include <immintrin.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

// e^x: reduction by ln 2, Taylor polynomial of degree 9, scaling by the processor.
static inline __m512d vector_exp(__m512d x) {
    __m512d n = _mm512_roundscale_pd(_mm512_mul_pd(x, _mm512_set1_pd(1.4426950408889634)), 8);
    __m512d r = _mm512_fnmadd_pd(n, _mm512_set1_pd(0.6931471805599453), x), sum = _mm512_set1_pd(1.0 / 362880);
    const double inverse[] = {1.0 / 40320, 1.0 / 5040, 1.0 / 720, 1.0 / 120, 1.0 / 24, 1.0 / 6, 0.5, 1, 1};
    for (int i = 0; i < 9; i++) sum = _mm512_fmadd_pd(sum, r, _mm512_set1_pd(inverse[i]));
    return _mm512_scalef_pd(sum, n);
}

#define FLOOR(N, D, BLOCKS)                                                                        \
    static void predict_##N(const double *x, const double *at, const double *alpha,                \
                            const double *factor, double *mean, double *variance) {                \
        double k[BLOCKS * 8] __attribute__((aligned(64)));                                         \
        __m512d sum = _mm512_setzero_pd(), v[BLOCKS], norm = _mm512_setzero_pd();                  \
        for (int b = 0; b < BLOCKS; b++) {                                                         \
            __m512d q = _mm512_setzero_pd();                                                       \
            for (int d = 0; d < D; d++) {                                                          \
                __m512d gap = _mm512_sub_pd(_mm512_load_pd(x + (d * BLOCKS + b) * 8), _mm512_set1_pd(at[d])); \
                q = _mm512_fmadd_pd(gap, gap, q);                                                  \
            }                                                                                      \
            __m512d e = vector_exp(_mm512_mul_pd(q, _mm512_set1_pd(-0.5)));                        \
            _mm512_store_pd(k + b * 8, e);                                                         \
            sum = _mm512_fmadd_pd(e, _mm512_load_pd(alpha + b * 8), sum);                          \
            v[b] = _mm512_setzero_pd();                                                            \
        }                                                                                          \
        _Pragma("GCC unroll 16") for (int first = 0; first < BLOCKS; first++)                      \
            for (int j = first * 8; j < first * 8 + 8 && j < N; j++) {                             \
                __m512d kj = _mm512_set1_pd(k[j]);                                                 \
                _Pragma("GCC unroll 16") for (int b = first; b < BLOCKS; b++, factor += 8)         \
                    v[b] = _mm512_fmadd_pd(_mm512_load_pd(factor), kj, v[b]);                      \
            }                                                                                      \
        for (int b = 0; b < BLOCKS; b++) norm = _mm512_fmadd_pd(v[b], v[b], norm);                 \
        *mean = _mm512_reduce_add_pd(sum);                                                         \
        *variance = 1 - _mm512_reduce_add_pd(norm);                                                \
    }                                                                                              \
    static void floor_##N(void) {                                                                  \
        size_t bytes = BLOCKS * 8 * BLOCKS * 8 * sizeof(double);                                   \
        double *x = aligned_alloc(64, bytes), *factor = aligned_alloc(64, bytes), times[31];       \
        for (size_t i = 0; i < bytes / 8; i++) x[i] = factor[i] = 1e-3 * (i % 97);                 \
        double at[8] = {0}, mean, variance;                                                        \
        for (int r = 0; r < 31; r++) {                                                             \
            double begin = now();                                                                  \
            for (int i = 0; i < 20000; i++) {                                                      \
                predict_##N(x, at, x, factor, &mean, &variance);                                   \
                at[0] = 1e-6 * (mean + variance);                                                  \
            }                                                                                      \
            times[r] = (now() - begin) / 20000 * 1e9;                                              \
        }                                                                                          \
        qsort(times, 31, sizeof(double), ascending);                                               \
        printf("one prediction, N=%d d=%d, each waiting for the last: %.1f ns (checksum %g)\n", N, D, times[15], mean + variance); \
    }

FLOOR(20, 2, 3)
FLOOR(100, 4, 13)

int main(void) {
    floor_20();
    floor_100();
}
