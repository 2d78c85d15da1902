/* What every generated program is made of: integers of LANES tracks at once.

   i32, i64, i128 and iwide hold one integer of 32, 64, 128 bits or of any length for each track. A flag is an
   i32, -1 where it is true, else 0. The first two are vectors of the compiler, for which it has operators;
   plain loops over their lanes, inlined, become single instructions. The others are computed lane by lane. */

#ifndef KALMANHDL_ENGINE_H
#define KALMANHDL_ENGINE_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifndef INLINE
#define INLINE static inline __attribute__((always_inline, unused))
#endif
/* Written out at every use, operations of long integers would take minutes to compile. */
#define CALL static __attribute__((noinline, unused))
/* As many tracks as the processor's vectors have 32-bit integers. */
#if defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX2__)
#define LANES 8
#else
#define LANES 4
#endif
const int32_t lanes = LANES;

/* Groups that go through a step before the next: as many as keep old and new states in the second-level cache, so
   that rows of arrays are read and written in long runs. */
enum { STATES_SIZE = 1 << 17 };
#define GROUPS_OF(state) (STATES_SIZE / 2 / (sizeof(state) + 1) + 1)

#define EACH for (int k = 0; k < LANES; k++)

typedef int32_t i32 __attribute__((vector_size(4 * LANES)));
typedef int64_t i64 __attribute__((vector_size(8 * LANES)));
typedef float floats __attribute__((vector_size(4 * LANES)));
typedef double reals __attribute__((vector_size(8 * LANES)));
typedef struct { __int128 lane[LANES]; } i128;
typedef struct { wide lane[LANES]; } iwide;

/* Integers of one type as another that holds them. */
INLINE i64 i64_of_i32(i32 a) { return __builtin_convertvector(a, i64); }
INLINE i32 i32_of_i64(i64 a) { return __builtin_convertvector(a, i32); }
CALL i128 i128_of_i64(i64 a) { i128 r; EACH r.lane[k] = a[k]; return r; }
CALL i64 i64_of_i128(i128 a) { i64 r; EACH r[k] = (int64_t)a.lane[k]; return r; }
CALL iwide iwide_of_i128(i128 a) { iwide r; EACH r.lane[k] = wide_of(a.lane[k]); return r; }
CALL i128 i128_of_iwide(iwide a) { i128 r; EACH r.lane[k] = wide_low(a.lane[k]); return r; }

/* `shift` is by a count for each lane. */
#define OF_VECTORS(type, element) \
    INLINE type all_##type(element a) { return a - (type){0}; }                                          \
    INLINE type add_##type(type a, type b) { return a + b; }                                             \
    INLINE type subtract_##type(type a, type b) { return a - b; }                                        \
    INLINE type multiply_##type(type a, type b) { return a * b; }                                        \
    INLINE type and_##type(type a, type b) { return a & b; }                                             \
    INLINE type xor_##type(type a, type b) { return a ^ b; }                                             \
    INLINE type left_##type(type a, int count) { return a << count; }                                    \
    INLINE type right_##type(type a, int count) { return a >> count; }                                   \
    INLINE type shift_##type(type a, i32 count) { return a << __builtin_convertvector(count, type); }    \
    INLINE type select_##type(i32 flag, type a, type b)                                                  \
    {                                                                                                    \
        type mask = __builtin_convertvector(flag, type);                                                 \
        return (a & mask) | (b & ~mask);                                                                 \
    }
OF_VECTORS(i32, int32_t)
OF_VECTORS(i64, int64_t)

INLINE i32 less_i32(i32 a, i32 b) { return a < b; }
INLINE i32 equal_i32(i32 a, i32 b) { return a == b; }
INLINE i32 minimum_i32(i32 a, i32 b) { EACH a[k] = a[k] < b[k] ? a[k] : b[k]; return a; }
INLINE i32 maximum_i32(i32 a, i32 b) { EACH a[k] = a[k] > b[k] ? a[k] : b[k]; return a; }

/* The sign of a difference, whether or not it overflows: vectors of two registers are compared lane by lane. */
INLINE i32 less_i64(i64 a, i64 b)
{
    i64 difference = a - b;
    return __builtin_convertvector((difference ^ ((a ^ b) & (difference ^ a))) >> 63, i32);
}
INLINE i32 equal_i64(i64 a, i64 b)
{
    i64 difference = a ^ b;
    return ~__builtin_convertvector((difference | -difference) >> 63, i32);
}
INLINE i64 minimum_i64(i64 a, i64 b) { return select_i64(less_i64(a, b), a, b); }
INLINE i64 maximum_i64(i64 a, i64 b) { return select_i64(less_i64(a, b), b, a); }

#define OF_LONGS(type, one)                                                                              \
    CALL type all_##type(one a) { type r; EACH r.lane[k] = a; return r; }                                \
    LANEWISE(type, type, add, type b, .lane, one##_add(x, b.lane[k]))                                    \
    LANEWISE(type, type, subtract, type b, .lane, one##_subtract(x, b.lane[k]))                          \
    LANEWISE(type, type, multiply, type b, .lane, one##_multiply(x, b.lane[k]))                          \
    LANEWISE(type, type, divide, type b, .lane, one##_divide(x, b.lane[k]))                              \
    LANEWISE(type, type, and, type b, .lane, one##_and(x, b.lane[k]))                                    \
    LANEWISE(type, type, xor, type b, .lane, one##_xor(x, b.lane[k]))                                    \
    LANEWISE(type, type, left, int count, .lane, one##_left(x, count))                                   \
    LANEWISE(type, type, right, int count, .lane, one##_right(x, count))                                 \
    LANEWISE(type, type, shift, i32 count, .lane, one##_left(x, count[k]))                               \
    LANEWISE(type, i32, less, type b, , -one##_less(x, b.lane[k]))                                       \
    LANEWISE(type, i32, equal, type b, , -one##_equal(x, b.lane[k]))                                     \
    LANEWISE(type, type, minimum, type b, .lane, one##_less(x, b.lane[k]) ? x : b.lane[k])               \
    LANEWISE(type, type, maximum, type b, .lane, one##_less(x, b.lane[k]) ? b.lane[k] : x)               \
    CALL type select_##type(i32 flag, type a, type b) { EACH if (!flag[k]) a.lane[k] = b.lane[k]; return a; } \
    CALL i32 length_##type(type a) { i32 r; EACH r[k] = one##_length(a.lane[k]); return r; }
#define LANEWISE(type, result, name, other, part, expression)                                            \
    CALL result name##_##type(type a, other)                                                             \
    {                                                                                                    \
        result r;                                                                                        \
        EACH { __auto_type x = a.lane[k]; r part[k] = expression; }                                      \
        return r;                                                                                        \
    }

typedef __int128 int128;
INLINE int128 int128_add(int128 a, int128 b) { return a + b; }
INLINE int128 int128_subtract(int128 a, int128 b) { return a - b; }
INLINE int128 int128_multiply(int128 a, int128 b) { return a * b; }
INLINE int128 int128_divide(int128 a, int128 b) { return a / b - (a % b < 0); }
INLINE int128 int128_and(int128 a, int128 b) { return a & b; }
INLINE int128 int128_xor(int128 a, int128 b) { return a ^ b; }
INLINE int128 int128_left(int128 a, int count) { return a << count; }
INLINE int128 int128_right(int128 a, int count) { return a >> count; }
INLINE int32_t int128_less(int128 a, int128 b) { return a < b; }
INLINE int32_t int128_equal(int128 a, int128 b) { return a == b; }
INLINE int32_t int128_length(int128 a)
{
    return a >> 64 ? 128 - __builtin_clzll((uint64_t)(a >> 64)) : 64 - __builtin_clzll((uint64_t)a | 1);
}
OF_LONGS(i128, int128)
OF_LONGS(iwide, wide)

/* The number of bits of values above zero: the exponent of a floating-point number. The bit below the leading one
   is taken off, so that rounding does not carry into another power of two. */
#if defined(__AVX512CD__)
INLINE i32 length_i32(i32 a) { EACH a[k] = 32 - __builtin_clz((uint32_t)a[k]); return a; }
INLINE i32 length_i64(i64 a) { i32 r; EACH r[k] = 64 - __builtin_clzll((uint64_t)a[k]); return r; }
#else
INLINE i32 length_i32(i32 a) { return ((i32)__builtin_convertvector(a & ~(a >> 1), floats) >> 23) - 126; }
INLINE i32 length_i64(i64 a)
{
    i64 b = a & ~(a >> 1), two52 = (i64)((reals){0} + 0x1p52), two84 = (i64)((reals){0} + 0x1p84);
    reals upper = (reals)((b >> 32) | two84) - (0x1p84 + 0x1p52), lower = (reals)((b & UINT32_MAX) | two52);
    return __builtin_convertvector(((i64)(upper + lower) >> 52) - 1022, i32);
}
#endif

/* Floors of quotients, for divisors above zero; the second of integers below 2**51, which are doubles once they
   stand in the last bits of 1.5 * 2**52, and come back likewise. */
CALL i64 divide_i64(i64 a, i64 b) { EACH a[k] = a[k] / b[k] - (a[k] % b[k] < 0); return a; }
INLINE i64 divide_short(i64 a, i64 b)
{
    reals middle = (reals){0} + 0x1.8p52;
    reals exact = ((reals)(a + (i64)middle) - middle) / ((reals)(b + (i64)middle) - middle), nearest = exact + middle;
    return (i64)nearest - (i64)middle + ((i64)(exact - (nearest - middle)) >> 63);
}

INLINE i32 look_up(const int32_t *table, i32 index) { EACH index[k] = table[index[k]]; return index; }

/* Rows of a caller's array, from element `at` on; of the last group of a row only the first `n` tracks. */
#define ROWS(name, element, type, through)                                                               \
    typedef element vector_##name __attribute__((vector_size(sizeof(element) * LANES), aligned(1)));     \
    CALL type load_part_##name(const element *from, int64_t n)                                           \
    {                                                                                                    \
        type r = {0};                                                                                    \
        for (int64_t k = 0; k < n; k++) r[k] = from[k];                                                  \
        return r;                                                                                        \
    }                                                                                                    \
    CALL void store_part_##name(element *to, int64_t n, type a)                                          \
    {                                                                                                    \
        for (int64_t k = 0; k < n; k++) to[k] = (element)a[k];                                           \
    }                                                                                                    \
    INLINE type load_##name(const void *from, int64_t at, int64_t n)                                     \
    {                                                                                                    \
        const element *row = (const element *)from + at;                                                 \
        return n < LANES ? load_part_##name(row, n) : through(*(const vector_##name *)row, type);        \
    }                                                                                                    \
    INLINE void store_##name(void *to, int64_t at, int64_t n, type a)                                    \
    {                                                                                                    \
        element *row = (element *)to + at;                                                               \
        if (n < LANES)                                                                                   \
            store_part_##name(row, n, a);                                                                \
        else                                                                                             \
            *(vector_##name *)row = through(a, vector_##name);                                           \
    }
/* Compilers make few instructions of one doubling of the width after the other. */
typedef int16_t i16 __attribute__((vector_size(2 * LANES)));
#define TWICE(a, type) __builtin_convertvector(__builtin_convertvector(a, i16), type)
ROWS(uint8, uint8_t, i32, TWICE)
ROWS(int16, int16_t, i32, __builtin_convertvector)
ROWS(uint16, uint16_t, i32, __builtin_convertvector)
ROWS(int32, int32_t, i32, __builtin_convertvector)
ROWS(uint32, uint32_t, i64, __builtin_convertvector)
ROWS(int64, int64_t, i64, __builtin_convertvector)

/* A row of integers of 64 bits as narrower ones, 0 where a track has no step, and what any is above the least. */
#define TAKE(name, element)                                                                              \
    CALL const element *take_##name(const void *from, int64_t at, int64_t n, const uint8_t *active,      \
                                    int64_t low, uint64_t *above, element *restrict to)                  \
    {                                                                                                    \
        const int64_t *row = (const int64_t *)from + at;                                                 \
        uint64_t offsets = 0;                                                                            \
        if (active)                                                                                      \
            for (int64_t k = 0; k < n; k++) {                                                            \
                to[k] = (element)(row[k] & -(int64_t)active[at + k]);                                    \
                offsets |= (uint64_t)(row[k] & -(int64_t)active[at + k]) - (uint64_t)low;                \
            }                                                                                            \
        else                                                                                             \
            _Pragma("omp simd reduction(|:offsets)")                                                     \
            for (int64_t k = 0; k < n; k++) {                                                            \
                to[k] = (element)row[k];                                                                 \
                offsets |= (uint64_t)row[k] - (uint64_t)low;                                             \
            }                                                                                            \
        *above |= offsets;                                                                               \
        return to;                                                                                       \
    }
TAKE(int16, int16_t)
TAKE(uint16, uint16_t)
TAKE(int32, int32_t)
TAKE(uint32, uint32_t)
TAKE(int64, int64_t)

/* Whether flags from element `at` on, one for each lane, are all as they are said to be. */
INLINE int32_t all_alike(const void *flags, int64_t at, uint32_t value)
{
    uint32_t differ = 0, word;
    for (int k = 0; k < LANES; k += 4) {
        memcpy(&word, (const uint8_t *)flags + at + k, 4);
        differ |= word ^ value * 0x01010101;
    }
    return !differ;
}

CALL iwide load_limbs(const void *from, int64_t at, int64_t n, int limbs)
{
    iwide r;
    EACH r.lane[k] = k < n ? wide_load((const uint64_t *)from + (at + k) * limbs, limbs) : wide_of(0);
    return r;
}

CALL void store_limbs(void *to, int64_t at, int64_t n, int limbs, iwide a)
{
    for (int64_t k = 0; k < n; k++) wide_store((uint64_t *)to + (at + k) * limbs, limbs, a.lane[k]);
}

/* Rounding to the nearest and subnormals, whatever other libraries have left the processor at. */
#if defined(__x86_64__)
INLINE uint64_t begin_arithmetic(void)
{
    uint64_t before = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(0x1f80);
    return before;
}
INLINE void end_arithmetic(uint64_t before) { __builtin_ia32_ldmxcsr((unsigned)before); }
#elif defined(__aarch64__)
INLINE void end_arithmetic(uint64_t before) { __asm__ volatile("msr fpcr, %0" : : "r"(before)); }
INLINE uint64_t begin_arithmetic(void)
{
    uint64_t before;
    __asm__ volatile("mrs %0, fpcr" : "=r"(before));
    end_arithmetic(0);
    return before;
}
#else
INLINE uint64_t begin_arithmetic(void) { return 0; }
INLINE void end_arithmetic(uint64_t before) { (void)before; }
#endif

/* The first n lanes. */
INLINE i32 first_lanes(int64_t n) { i32 r; EACH r[k] = -(k < n); return r; }

INLINE int32_t any(i32 flag) { int32_t r = 0; EACH r |= flag[k]; return r; }

/* Moves what lanes have counted to the caller's sums. */
CALL int32_t sum_up(int number, i32 *counts, int64_t *sums)
{
    for (int c = 0; c < number; c++) {
        EACH sums[c] += counts[c][k];
        counts[c] = (i32){0};
    }
    return 0;
}

#endif
