/* What every generated program uses beside wide integers. */

#ifndef KALMANHDL_ENGINE_H
#define KALMANHDL_ENGINE_H

#include <stdint.h>
#include <stdlib.h>

static inline double clamp(double value, double low, double high)
{
    value = value < low ? low : value;
    return value > high ? high : value;
}

/* Floors, for divisors above zero. */
static inline int64_t floor_divide_64(int64_t a, int64_t b) { return a / b - (a % b < 0); }
static inline __int128 floor_divide_128(__int128 a, __int128 b) { return a / b - (a % b < 0); }

/* The number of bits of a value above zero. */
/* By the exponent of a float, which compilers vectorise; clearing the second bit keeps it from rounding up. */
static inline int32_t bit_length_32(int32_t a)
{
    union { float number; int32_t bits; } as = {.number = (float)(a & ~(a >> 1))};
    return (as.bits >> 23) - 126;
}
static inline int64_t bit_length_64(int64_t a) { return 64 - __builtin_clzll((uint64_t)a); }
static inline int64_t bit_length_128(__int128 a)
{
    return a >> 64 ? 64 + bit_length_64((int64_t)(a >> 64)) : bit_length_64((int64_t)a);
}

/* A row of a caller's array, from element `at` on, into a block and back; calls keep programs short. */
#define BLOCK_COPY(load, store, block, array)                                                            \
    __attribute__((noinline, unused))                                                                    \
    static void load(block *restrict to, const void *from, int64_t at, int64_t n)                        \
    {                                                                                                    \
        const array *restrict row = (const array *)from + at;                                            \
        _Pragma("omp simd") for (int64_t t = 0; t < n; t++) to[t] = (block)row[t];                       \
    }                                                                                                    \
    __attribute__((noinline, unused))                                                                    \
    static void store(const block *restrict from, void *to, int64_t at, int64_t n)                       \
    {                                                                                                    \
        array *restrict row = (array *)to + at;                                                          \
        _Pragma("omp simd") for (int64_t t = 0; t < n; t++) row[t] = (array)from[t];                     \
    }

BLOCK_COPY(load_flags, store_flags, int32_t, uint8_t)
BLOCK_COPY(load_32, store_32, int32_t, int64_t)
BLOCK_COPY(load_64, store_64, int64_t, int64_t)

#endif
