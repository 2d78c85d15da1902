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
#define EACH for (int k = 0; k < LANES; k++)

typedef int32_t i32 __attribute__((vector_size(4 * LANES)));
typedef int64_t i64 __attribute__((vector_size(8 * LANES)));
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
    INLINE i32 less_##type(type a, type b) { i32 r; EACH r[k] = -(a[k] < b[k]); return r; }              \
    INLINE i32 equal_##type(type a, type b) { i32 r; EACH r[k] = -(a[k] == b[k]); return r; }            \
    INLINE type minimum_##type(type a, type b) { EACH a[k] = a[k] < b[k] ? a[k] : b[k]; return a; }      \
    INLINE type maximum_##type(type a, type b) { EACH a[k] = a[k] > b[k] ? a[k] : b[k]; return a; }      \
    INLINE type select_##type(i32 flag, type a, type b)                                                  \
    {                                                                                                    \
        type mask = __builtin_convertvector(flag, type);                                                 \
        return (a & mask) | (b & ~mask);                                                                 \
    }
OF_VECTORS(i32, int32_t)
OF_VECTORS(i64, int64_t)

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
    return a >> 64 ? 128 - __builtin_clzll((uint64_t)(a >> 64)) : 64 - __builtin_clzll((uint64_t)a);
}
OF_LONGS(i128, int128)
OF_LONGS(iwide, wide)

/* The number of bits of values above zero. */
INLINE i32 length_i32(i32 a) { EACH a[k] = 32 - __builtin_clz((uint32_t)a[k]); return a; }
INLINE i32 length_i64(i64 a) { i32 r; EACH r[k] = 64 - __builtin_clzll((uint64_t)a[k]); return r; }

/* Floors of quotients, for divisors above zero; the second of integers below 2**52, clamped. */
CALL i64 divide_i64(i64 a, i64 b) { EACH a[k] = a[k] / b[k] - (a[k] % b[k] < 0); return a; }
INLINE i64 divide_short(i64 a, i64 b, double low, double high)
{
    reals exact = __builtin_convertvector(a, reals) / __builtin_convertvector(b, reals);
    EACH exact[k] = exact[k] < low ? low : exact[k];
    EACH exact[k] = exact[k] > high ? high : exact[k];
    i64 quotient = __builtin_convertvector(exact, i64);
    reals whole = __builtin_convertvector(quotient, reals);
    EACH quotient[k] -= exact[k] < whole[k];
    return quotient;
}

INLINE i32 look_up(const int32_t *table, i32 index) { EACH index[k] = table[index[k]]; return index; }

/* Rows of a caller's array, from element `at` on; of the last group of a row only the first `n` tracks. */
#define ROWS(name, element, type, through)                                                                       \
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
            *(vector_##name *)row = __builtin_convertvector(a, vector_##name);                           \
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
