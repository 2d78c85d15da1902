/* Numbers of floating-point formats, LANES of them at once: each operation is exact, then rounded once.

   A format is one C type with its functions, made by one of four macros, the first that can:
     NATIVE   the processor's float or double, rounded to the nearest;
     DOUBLES  significands of up to 25 bits in doubles, rounded to the format after every operation. Of products
              a double has every bit, of sums, quotients and square roots more than twice as many as the
              format and two, so that rounding twice is rounding once (Figueroa 1995); where it is not enough,
              toward zero and for fused operations, sums are rounded to odd in between (Boldo and Melquiond 2008);
     SOFT     raw integers of up to 64 bits, lane by lane.
   arithmetic/floating.py is what they all give. */

#ifndef KALMANHDL_FLOAT_H
#define KALMANHDL_FLOAT_H

typedef struct { int exponent, mantissa, toward_zero, subnormals; } format;
typedef unsigned __int128 u128;

INLINE uint64_t sign_bit(format f) { return (uint64_t)1 << (f.exponent + f.mantissa); }
INLINE uint64_t infinity(format f) { return (((uint64_t)1 << f.exponent) - 1) << f.mantissa; }
INLINE uint64_t the_nan(format f) { return infinity(f) | (uint64_t)1 << (f.mantissa - 1); }
INLINE int bias(format f) { return (1 << (f.exponent - 1)) - 1; }
INLINE uint64_t magnitude(format f, uint64_t a) { return a & (sign_bit(f) - 1); }
INLINE int is_nan(format f, uint64_t a) { return magnitude(f, a) > infinity(f); }

/* With the one NaN, and without subnormals that do not count. Everything below takes only such numbers. */
INLINE uint64_t canonical(format f, uint64_t a)
{
    if (is_nan(f, a))
        return the_nan(f);
    return !f.subnormals && magnitude(f, a) >> f.mantissa == 0 ? a & sign_bit(f) : a;
}

INLINE int bits_of(u128 a)
{
    uint64_t high = a >> 64, low = a;
    return high ? 128 - __builtin_clzll(high) : low ? 64 - __builtin_clzll(low) : 0;
}

/* A finite number as an integer times a power of two. */
INLINE uint64_t significand(format f, uint64_t a, int *power)
{
    uint64_t bits = magnitude(f, a), exponent = bits >> f.mantissa;
    *power = (exponent ? (int)exponent : 1) - bias(f) - f.mantissa;
    return (bits & (((uint64_t)1 << f.mantissa) - 1)) | (uint64_t)(exponent != 0) << f.mantissa;
}

/* units / 2**down, rounded; there is a bit more of it if `sticky`, but nothing that counts if down < 2. */
INLINE u128 rounded(format f, u128 units, int down, int sticky)
{
    if (down <= 0)
        return units << -down;
    if (down > 127)
        return 0;
    u128 whole = units >> down, rest = units - (whole << down), half = (u128)1 << (down - 1);
    return whole + (!f.toward_zero && (rest > half || (rest == half && (sticky || (whole & 1)))));
}

/* units * 2**power, and a bit more if `sticky`; 0 < units < 2**127. */
CALL uint64_t encoded(format f, uint64_t sign, u128 units, int power, int sticky)
{
    int exponent = power + bits_of(units) - 1, least = 1 - bias(f);
    if (!f.subnormals) {
        /* Judged with the exponent that rounding leaves, however small. */
        u128 whole = rounded(f, units, exponent - f.mantissa - power, sticky);
        if (exponent + bits_of(whole) - f.mantissa - 1 < least)
            return sign;
    }
    int last = (exponent > least ? exponent : least) - f.mantissa;
    if (last + f.mantissa > bias(f))
        return sign | (infinity(f) - f.toward_zero);
    uint64_t whole = rounded(f, units, last - power, sticky);
    /* A significand that rounds up to the next power of two carries into the exponent by itself. */
    uint64_t bits = whole + ((uint64_t)(last + f.mantissa - least) << f.mantissa);
    return sign | (bits < infinity(f) ? bits : infinity(f) - f.toward_zero);
}

/* a * 2**i + b * 2**j with their signs; a and b have up to 120 bits. */
CALL uint64_t sum(format f, uint64_t sign, u128 a, int i, uint64_t other, u128 b, int j)
{
    if (!a || !b)
        return !a && !b ? sign & other : a ? encoded(f, sign, a, i, 0) : encoded(f, other, b, j, 0);
    /* Both begin at bit 125, so that what is shifted out is small beside what is left. */
    int up = 126 - bits_of(a);
    a <<= up, i -= up;
    up = 126 - bits_of(b);
    b <<= up, j -= up;
    if (j > i || (j == i && b > a)) {
        u128 c = a; a = b; b = c;
        int k = i; i = j; j = k;
        uint64_t s = sign; sign = other; other = s;
    }
    int down = i - j, sticky = 0;
    if (down > 125)
        sticky = 1, b = 0;
    else
        sticky = (b & (((u128)1 << down) - 1)) != 0, b >>= down;
    a = sign == other ? a + b : a - b - sticky;
    return a ? encoded(f, sign, a, i, sticky) : 0;
}

CALL uint64_t soft_add(format f, uint64_t a, uint64_t b)
{
    uint64_t top = infinity(f), s = a & sign_bit(f), t = b & sign_bit(f);
    if (is_nan(f, a) || is_nan(f, b))
        return the_nan(f);
    if (magnitude(f, a) == top)
        return magnitude(f, b) == top && a != b ? the_nan(f) : a;
    if (magnitude(f, b) == top)
        return b;
    int i, j;
    uint64_t x = significand(f, a, &i), y = significand(f, b, &j);
    return sum(f, s, x, i, t, y, j);
}

INLINE uint64_t soft_negate(format f, uint64_t a) { return is_nan(f, a) ? a : a ^ sign_bit(f); }

CALL uint64_t soft_multiply(format f, uint64_t a, uint64_t b)
{
    uint64_t top = infinity(f), sign = (a ^ b) & sign_bit(f);
    if (is_nan(f, a) || is_nan(f, b))
        return the_nan(f);
    if (magnitude(f, a) == top || magnitude(f, b) == top)
        return magnitude(f, a) && magnitude(f, b) ? sign | top : the_nan(f);
    int i, j;
    u128 product = (u128)significand(f, a, &i) * significand(f, b, &j);
    return product ? encoded(f, sign, product, i + j, 0) : sign;
}

CALL uint64_t soft_fused(format f, uint64_t a, uint64_t b, uint64_t c)
{
    uint64_t top = infinity(f), sign = (a ^ b) & sign_bit(f);
    if (is_nan(f, a) || is_nan(f, b) || is_nan(f, c))
        return the_nan(f);
    if (magnitude(f, a) == top || magnitude(f, b) == top)
        return soft_add(f, soft_multiply(f, a, b), c);
    if (magnitude(f, c) == top)
        return c;
    int i, j, k;
    u128 product = (u128)significand(f, a, &i) * significand(f, b, &j);
    uint64_t z = significand(f, c, &k);
    return sum(f, sign, product, i + j, c & sign_bit(f), z, k);
}

CALL uint64_t soft_divide(format f, uint64_t a, uint64_t b)
{
    uint64_t top = infinity(f), sign = (a ^ b) & sign_bit(f), x = magnitude(f, a), y = magnitude(f, b);
    if (x > top || y > top || (x == top && y == top) || (!x && !y))
        return the_nan(f);
    if (x == top || !y)
        return sign | top;
    if (y == top || !x)
        return sign;
    int i, j;
    u128 dividend = significand(f, a, &i), divisor = significand(f, b, &j);
    int up = 125 - bits_of(dividend);
    dividend <<= up;
    u128 quotient = dividend / divisor;
    return encoded(f, sign, quotient, i - up - j, quotient * divisor != dividend);
}

CALL uint64_t soft_square_root(format f, uint64_t a)
{
    if (is_nan(f, a) || !magnitude(f, a))
        return a;
    if (a & sign_bit(f))
        return the_nan(f);
    if (a == infinity(f))
        return a;
    int i;
    u128 rest = significand(f, a, &i);
    int up = 126 - bits_of(rest);
    up -= (i - up) & 1;
    rest <<= up;
    u128 root = 0;
    for (u128 digit = (u128)1 << 126; digit; digit >>= 2) {
        u128 tried = root + digit;
        root >>= 1;
        if (rest >= tried)
            rest -= tried, root += digit;
    }
    return encoded(f, 0, root, (i - up) / 2, rest != 0);
}

CALL uint64_t soft_scale(format f, uint64_t a, int exponent)
{
    if (magnitude(f, a) >= infinity(f) || !magnitude(f, a))
        return a;
    int i;
    uint64_t x = significand(f, a, &i);
    return encoded(f, a & sign_bit(f), x, i + exponent, 0);
}

CALL uint64_t soft_wrap(format f, uint64_t a)
{
    if (magnitude(f, a) >= infinity(f))
        return the_nan(f);
    int i;
    uint64_t units = significand(f, a, &i), sign = a & sign_bit(f);
    if (i >= 0 || !units)
        return 0;
    if (i <= -62)  /* Far below a half. */
        return a;
    uint64_t one = (uint64_t)1 << -i, rest = units & (one - 1);
    if (2 * rest > one || (2 * rest == one && !sign))
        rest = one - rest, sign ^= sign_bit(f);
    return rest ? encoded(f, sign, rest, i, 0) : 0;
}

INLINE double two_to_the(int exponent)
{
    union { uint64_t bits; double value; } power = {(uint64_t)(exponent + 1023) << 52};
    return power.value;
}

/* Doubles and numbers of a format; the format has no more bits than a double. */
typedef union { double value; uint64_t bits; } as_bits;
#define BINARY64 ((format){11, 52, 0, 1})

INLINE uint64_t soft_of_double(format f, double value)
{
    uint64_t bits = ((as_bits){value}).bits, sign = bits >> 63 ? sign_bit(f) : 0;
    if (value != value)
        return the_nan(f);
    if (magnitude(BINARY64, bits) == infinity(BINARY64))
        return sign | infinity(f);
    int i;
    uint64_t units = significand(BINARY64, bits, &i);
    return units ? encoded(f, sign, units, i, 0) : sign;
}

INLINE double double_of_soft(format f, uint64_t a)
{
    if (magnitude(f, a) > infinity(f))
        return __builtin_nan("");
    double value = __builtin_inf();
    if (magnitude(f, a) < infinity(f)) {
        int i;
        value = significand(f, a, &i);
        /* In two exact steps, since a power of two may be too small for a double of its own. */
        value = value * two_to_the(i / 2) * two_to_the(i - i / 2);
    }
    return a & sign_bit(f) ? -value : value;
}

/* The whole part of a number, from 0 to the last row of a table. */
INLINE int32_t row_of_double(double a, int32_t last) { return a >= last ? last : a > 0 ? (int32_t)a : 0; }
CALL int32_t row_of_soft(format f, uint64_t a, int32_t last)
{
    if (a > infinity(f))
        return 0;
    int i;
    uint64_t units = significand(f, a, &i);
    if (i >= 0)
        return !units ? 0 : a == infinity(f) || i > 31 || (u128)units << i > last ? last : (int32_t)(units << i);
    units = i > -64 ? units >> -i : 0;
    return units < last ? (int32_t)units : last;
}

/* What every type has, of `row` elements of arrays. */
#define OF_ELEMENTS(type, element)                                                                       \
    INLINE type all_##type(element a) { type r; EACH r[k] = a; return r; }                               \
    INLINE type select_##type(i32 flag, type a, type b)                                                  \
    {                                                                                                    \
        bits_##type mask = __builtin_convertvector(flag, bits_##type);                                   \
        return (type)(((bits_##type)a & mask) | ((bits_##type)b & ~mask));                               \
    }                                                                                                    \
    INLINE type row_##type(const element *rows, i32 index)                                               \
    {                                                                                                    \
        type r;                                                                                          \
        EACH r[k] = rows[index[k]];                                                                      \
        return r;                                                                                        \
    }                                                                                                    \
    CALL i32 index_##type(type a, int32_t last) { i32 r; EACH r[k] = row_of_##type(a[k], last); return r; }

/* What a number is above its nearest whole number, half of one being below. */
#define WRAPPED(rest) ((rest) == 0.5f ? -0.5f : (rest))

#define NATIVE(type, element, integer, top, nan, nearest)                                                \
    typedef element type __attribute__((vector_size(sizeof(element) * LANES)));                          \
    typedef integer bits_##type __attribute__((vector_size(sizeof(element) * LANES)));                   \
    typedef integer bits_of_##type __attribute__((vector_size(sizeof(element) * LANES), aligned(1)));    \
    INLINE int32_t row_of_##type(element a, int32_t last) { return row_of_double(a, last); }             \
    OF_ELEMENTS(type, element)                                                                           \
    INLINE type add_##type(type a, type b) { return a + b; }                                             \
    INLINE type subtract_##type(type a, type b) { return a - b; }                                        \
    INLINE type multiply_##type(type a, type b) { return a * b; }                                        \
    INLINE type divide_##type(type a, type b) { return a / b; }                                          \
    INLINE type negate_##type(type a) { return -a; }                                                     \
    INLINE type wrap_##type(type a)                                                                      \
    {                                                                                                    \
        EACH a[k] = WRAPPED(a[k] - nearest(a[k]));                                                       \
        return a;                                                                                        \
    }                                                                                                    \
    INLINE i32 negative_##type(type a) { i32 r; EACH r[k] = -(a[k] < 0); return r; }                     \
    INLINE i32 unbounded_##type(type a)                                                                  \
    {                                                                                                    \
        bits_##type bits = (bits_##type)a & top;                                                         \
        i32 r;                                                                                           \
        EACH r[k] = -(bits[k] == top);                                                                   \
        return r;                                                                                        \
    }                                                                                                    \
    INLINE type load_##type(const void *from, int64_t at, int64_t n)                                     \
    {                                                                                                    \
        const integer *row = (const integer *)from + at;                                                 \
        bits_##type bits = {0};                                                                          \
        if (n < LANES)                                                                                   \
            for (int64_t k = 0; k < n; k++) bits[k] = row[k];                                            \
        else                                                                                             \
            bits = *(const bits_of_##type *)row;                                                         \
        return (type)bits;                                                                               \
    }                                                                                                    \
    INLINE void store_##type(void *to, int64_t at, int64_t n, type a)                                    \
    {                                                                                                    \
        integer *row = (integer *)to + at;                                                               \
        bits_##type bits = (bits_##type)a;                                                               \
        EACH bits[k] = a[k] == a[k] ? bits[k] : nan;                                                     \
        if (n < LANES)                                                                                   \
            for (int64_t k = 0; k < n; k++) row[k] = bits[k];                                            \
        else                                                                                             \
            *(bits_of_##type *)row = bits;                                                               \
    }

/* The sum of doubles, where it is not exact the one of its neighbours whose last bit is one. */
INLINE reals odd_sum(reals a, reals b)
{
    reals s = a + b, part = s - a, error = (a - (s - part)) + (b - part);
    i64 bits = (i64)s;
    EACH {
        int64_t away = (error[k] > 0) == (s[k] > 0) ? 1 : -1;
        bits[k] += (error[k] > 0 || error[k] < 0) && !(bits[k] & 1) ? away : 0;
    }
    return (reals)bits;
}

/* Doubles rounded to a format. */
INLINE reals reals_rounded(format f, reals a)
{
    /* Beyond these exponents every number is zero or infinite, whatever its last bits. */
    int64_t least = f.subnormals ? 1 - bias(f) : -900, most = 900;
    i64 bits = (i64)a, sign = bits & INT64_MIN, exponent = ((bits >> 52) & 0x7ff) - 1023;
    EACH exponent[k] = exponent[k] < least ? least : exponent[k] > most ? most : exponent[k];
    reals unit = (reals)((exponent - f.mantissa + 1023) << 52);
    reals units = a * (reals)((f.mantissa - exponent + 1023) << 52), r;
    if (f.toward_zero)
        EACH r[k] = __builtin_trunc(units[k]);
    else
        EACH r[k] = __builtin_rint(units[k]);
    r *= unit;
    double lowest = two_to_the(1 - bias(f)), beyond = two_to_the(bias(f) + 1);
    double end = f.toward_zero ? beyond - two_to_the(bias(f) - f.mantissa) : __builtin_inf();
    EACH {
        double size = __builtin_fabs(r[k]);
        size = !f.subnormals && size < lowest ? 0 : size;
        size = size >= beyond && size < __builtin_inf() ? end : size;
        r[k] = size;
    }
    return (reals)((i64)r | sign);
}

#define DOUBLES(type, raw, ...)                                                                          \
    typedef reals type;                                                                                  \
    typedef i64 bits_##type;                                                                             \
    static const format format_##type = {__VA_ARGS__};                                                   \
    INLINE type rounded_##type(type a) { return reals_rounded((format){__VA_ARGS__}, a); }               \
    INLINE int32_t row_of_##type(double a, int32_t last) { return row_of_double(a, last); }              \
    OF_ELEMENTS(type, double)                                                                            \
    CALL type add_##type(type a, type b)                                                                 \
    {                                                                                                    \
        return rounded_##type(format_##type.toward_zero ? odd_sum(a, b) : a + b);                        \
    }                                                                                                    \
    INLINE type negate_##type(type a) { return -a; }                                                     \
    INLINE type subtract_##type(type a, type b) { return add_##type(a, -b); }                            \
    CALL type multiply_##type(type a, type b) { return rounded_##type(a * b); }                          \
    CALL type fused_##type(type a, type b, type c) { return rounded_##type(odd_sum(a * b, c)); }         \
    CALL type divide_##type(type a, type b) { return rounded_##type(a / b); }                            \
    CALL type scale_##type(type a, int exponent)                                                         \
    {                                                                                                    \
        return rounded_##type(a * two_to_the(exponent < -400 ? -400 : exponent > 400 ? 400 : exponent)); \
    }                                                                                                    \
    CALL type square_root_##type(type a)                                                                 \
    {                                                                                                    \
        EACH a[k] = __builtin_sqrt(a[k]);                                                                \
        return rounded_##type(a);                                                                        \
    }                                                                                                    \
    CALL type wrap_##type(type a)                                                                        \
    {                                                                                                    \
        EACH a[k] = WRAPPED(a[k] - __builtin_rint(a[k]));                                                \
        return rounded_##type(a);                                                                        \
    }                                                                                                    \
    INLINE i32 negative_##type(type a) { i32 r; EACH r[k] = -(a[k] < 0); return r; }                     \
    INLINE i32 unbounded_##type(type a)                                                                  \
    {                                                                                                    \
        i32 r;                                                                                           \
        EACH r[k] = -!(__builtin_fabs(a[k]) < __builtin_inf());                                          \
        return r;                                                                                        \
    }                                                                                                    \
    CALL type load_##type(const void *from, int64_t at, int64_t n)                                       \
    {                                                                                                    \
        type r = {0};                                                                                    \
        for (int64_t k = 0; k < n; k++)                                                                  \
            r[k] = double_of_soft(format_##type, canonical(format_##type, ((const raw *)from)[at + k])); \
        return r;                                                                                        \
    }                                                                                                    \
    CALL void store_##type(void *to, int64_t at, int64_t n, type a)                                      \
    {                                                                                                    \
        for (int64_t k = 0; k < n; k++)                                                                  \
            ((raw *)to)[at + k] = soft_of_double(format_##type, a[k]);                                   \
    }

#define SOFT(type, raw, ...)                                                                             \
    typedef i64 type;                                                                                    \
    typedef i64 bits_##type;                                                                             \
    static const format format_##type = {__VA_ARGS__};                                                   \
    INLINE int32_t row_of_##type(int64_t a, int32_t last) { return row_of_soft(format_##type, a, last); } \
    OF_ELEMENTS(type, int64_t)                                                                           \
    LANES_OF(type, add, (type a, type b), soft_add(format_##type, a[k], b[k]))                           \
    LANES_OF(type, subtract, (type a, type b),                                                           \
             soft_add(format_##type, a[k], soft_negate(format_##type, b[k])))                            \
    LANES_OF(type, multiply, (type a, type b), soft_multiply(format_##type, a[k], b[k]))                 \
    LANES_OF(type, divide, (type a, type b), soft_divide(format_##type, a[k], b[k]))                     \
    LANES_OF(type, fused, (type a, type b, type c), soft_fused(format_##type, a[k], b[k], c[k]))         \
    LANES_OF(type, negate, (type a), soft_negate(format_##type, a[k]))                                   \
    LANES_OF(type, scale, (type a, int exponent), soft_scale(format_##type, a[k], exponent))             \
    LANES_OF(type, square_root, (type a), soft_square_root(format_##type, a[k]))                         \
    LANES_OF(type, wrap, (type a), soft_wrap(format_##type, a[k]))                                       \
    INLINE i32 negative_##type(type a)                                                                   \
    {                                                                                                    \
        i32 r;                                                                                           \
        EACH r[k] = -((a[k] & sign_bit(format_##type)) && magnitude(format_##type, a[k]));               \
        return r;                                                                                        \
    }                                                                                                    \
    INLINE i32 unbounded_##type(type a)                                                                  \
    {                                                                                                    \
        i32 r;                                                                                           \
        EACH r[k] = -(magnitude(format_##type, a[k]) >= infinity(format_##type));                        \
        return r;                                                                                        \
    }                                                                                                    \
    CALL type load_##type(const void *from, int64_t at, int64_t n)                                       \
    {                                                                                                    \
        type r = {0};                                                                                    \
        for (int64_t k = 0; k < n; k++)                                                                  \
            r[k] = canonical(format_##type, ((const raw *)from)[at + k]);                                \
        return r;                                                                                        \
    }                                                                                                    \
    CALL void store_##type(void *to, int64_t at, int64_t n, type a)                                      \
    {                                                                                                    \
        for (int64_t k = 0; k < n; k++) ((raw *)to)[at + k] = a[k];                                      \
    }
#define LANES_OF(type, name, parameters, expression)                                                     \
    CALL type name##_##type parameters { type r; EACH r[k] = expression; return r; }

/* Single and double precision, as processors have them. */
NATIVE(binary32, float, int32_t, 0x7f800000, 0x7fc00000, __builtin_rintf)
INLINE binary32 square_root_binary32(binary32 a) { EACH a[k] = __builtin_sqrtf(a[k]); return a; }
CALL binary32 scale_binary32(binary32 a, int exponent)
{
    double power = two_to_the(exponent < -400 ? -400 : exponent > 400 ? 400 : exponent);
    EACH a[k] = a[k] * power;
    return a;
}
INLINE binary32 fused_binary32(binary32 a, binary32 b, binary32 c)
{
#ifdef __FP_FAST_FMAF
    EACH a[k] = __builtin_fmaf(a[k], b[k], c[k]);
    return a;
#else
    reals x = __builtin_convertvector(a, reals), y = __builtin_convertvector(b, reals);
    return __builtin_convertvector(odd_sum(x * y, __builtin_convertvector(c, reals)), binary32);
#endif
}

NATIVE(binary64, double, int64_t, 0x7ff0000000000000, 0x7ff8000000000000, __builtin_rint)
INLINE binary64 square_root_binary64(binary64 a) { EACH a[k] = __builtin_sqrt(a[k]); return a; }
CALL binary64 scale_binary64(binary64 a, int exponent)
{
    i64 bits = (i64)a;
    EACH bits[k] = a[k] == a[k] ? soft_scale(BINARY64, bits[k], exponent) : bits[k];
    return (binary64)bits;
}
INLINE binary64 fused_binary64(binary64 a, binary64 b, binary64 c)
{
#ifdef __FP_FAST_FMA
    EACH a[k] = __builtin_fma(a[k], b[k], c[k]);
#else
    i64 x = (i64)a, y = (i64)b, z = (i64)c;
    EACH x[k] = soft_fused(BINARY64, canonical(BINARY64, x[k]), canonical(BINARY64, y[k]), canonical(BINARY64, z[k]));
    a = (binary64)x;
#endif
    return a;
}

#endif
