/* Two's complement integers of WIDE_LIMBS 64-bit limbs, least significant first.

   Results are exact modulo 2**(64 * WIDE_LIMBS); whoever includes this file chooses WIDE_LIMBS >= 2 so that
   no value and no intermediate of the program leaves that range. */

#ifndef KALMANHDL_WIDE_H
#define KALMANHDL_WIDE_H

#include <stdint.h>

/* Written out at every use, a program of wide integers would take minutes to compile. */
#define WIDE_CALL __attribute__((noinline, unused)) static

typedef struct { uint64_t limb[WIDE_LIMBS]; } wide;

static inline int32_t wide_negative(wide a) { return (int32_t)(a.limb[WIDE_LIMBS - 1] >> 63); }

WIDE_CALL wide wide_of(__int128 a)
{
    wide r;
    for (int i = 0; i < WIDE_LIMBS; i++)
        r.limb[i] = (uint64_t)(a >> (i == 0 ? 0 : i == 1 ? 64 : 127));
    return r;
}

static inline __int128 wide_low(wide a) { return (__int128)((unsigned __int128)a.limb[1] << 64 | a.limb[0]); }

WIDE_CALL wide wide_add(wide a, wide b)
{
    unsigned __int128 sum = 0;
    for (int i = 0; i < WIDE_LIMBS; i++) {
        sum += (unsigned __int128)a.limb[i] + b.limb[i];
        a.limb[i] = (uint64_t)sum;
        sum >>= 64;
    }
    return a;
}

WIDE_CALL wide wide_negate(wide a)
{
    uint64_t carry = 1;
    for (int i = 0; i < WIDE_LIMBS; i++) {
        a.limb[i] = ~a.limb[i] + carry;
        carry = carry && a.limb[i] == 0;
    }
    return a;
}

WIDE_CALL wide wide_subtract(wide a, wide b) { return wide_add(a, wide_negate(b)); }

WIDE_CALL wide wide_multiply(wide a, wide b)
{
    wide r = wide_of(0);
    for (int i = 0; i < WIDE_LIMBS; i++) {
        uint64_t carry = 0;
        for (int j = 0; i + j < WIDE_LIMBS; j++) {
            unsigned __int128 part = (unsigned __int128)a.limb[i] * b.limb[j] + r.limb[i + j] + carry;
            r.limb[i + j] = (uint64_t)part;
            carry = (uint64_t)(part >> 64);
        }
    }
    return r;
}

WIDE_CALL wide wide_and(wide a, wide b)
{
    for (int i = 0; i < WIDE_LIMBS; i++)
        a.limb[i] &= b.limb[i];
    return a;
}

WIDE_CALL wide wide_xor(wide a, wide b)
{
    for (int i = 0; i < WIDE_LIMBS; i++)
        a.limb[i] ^= b.limb[i];
    return a;
}

WIDE_CALL wide wide_left(wide a, int count)
{
    wide r;
    int whole = count / 64, part = count % 64;
    for (int i = WIDE_LIMBS - 1; i >= 0; i--) {
        uint64_t high = i >= whole ? a.limb[i - whole] : 0;
        uint64_t low = i > whole ? a.limb[i - whole - 1] : 0;
        r.limb[i] = part ? high << part | low >> (64 - part) : high;
    }
    return r;
}

/* An arithmetic shift: a floor. */
WIDE_CALL wide wide_right(wide a, int count)
{
    wide r;
    uint64_t sign = -(uint64_t)wide_negative(a);
    int whole = count / 64, part = count % 64;
    for (int i = 0; i < WIDE_LIMBS; i++) {
        uint64_t low = i + whole < WIDE_LIMBS ? a.limb[i + whole] : sign;
        uint64_t high = i + whole + 1 < WIDE_LIMBS ? a.limb[i + whole + 1] : sign;
        r.limb[i] = part ? low >> part | high << (64 - part) : low;
    }
    return r;
}

WIDE_CALL int32_t wide_equal(wide a, wide b)
{
    uint64_t difference = 0;
    for (int i = 0; i < WIDE_LIMBS; i++)
        difference |= a.limb[i] ^ b.limb[i];
    return difference == 0;
}

WIDE_CALL int32_t wide_less(wide a, wide b)
{
    if (wide_negative(a) != wide_negative(b))
        return wide_negative(a);
    for (int i = WIDE_LIMBS - 1; i >= 0; i--)
        if (a.limb[i] != b.limb[i])
            return a.limb[i] < b.limb[i];
    return 0;
}

/* The number of bits of a value >= 0. */
WIDE_CALL int wide_length(wide a)
{
    for (int i = WIDE_LIMBS - 1; i >= 0; i--)
        if (a.limb[i])
            return 64 * i + 64 - __builtin_clzll(a.limb[i]);
    return 0;
}

/* The floor of a / b for b > 0, one bit after the other. */
WIDE_CALL wide wide_divide(wide a, wide b)
{
    int32_t negative = wide_negative(a);
    wide quotient = wide_of(0), rest = wide_of(0), magnitude = negative ? wide_negate(a) : a;
    for (int bit = wide_length(magnitude) - 1; bit >= 0; bit--) {
        rest = wide_left(rest, 1);
        rest.limb[0] |= magnitude.limb[bit / 64] >> (bit % 64) & 1;
        if (!wide_less(rest, b)) {
            rest = wide_subtract(rest, b);
            quotient.limb[bit / 64] |= (uint64_t)1 << (bit % 64);
        }
    }
    if (!negative)
        return quotient;
    quotient = wide_negate(quotient);
    return wide_equal(rest, wide_of(0)) ? quotient : wide_subtract(quotient, wide_of(1));
}

WIDE_CALL wide wide_load(const uint64_t *from, int limbs)
{
    wide r;
    uint64_t sign = -(from[limbs - 1] >> 63);
    for (int i = 0; i < WIDE_LIMBS; i++)
        r.limb[i] = i < limbs ? from[i] : sign;
    return r;
}

WIDE_CALL void wide_store(uint64_t *to, int limbs, wide a)
{
    for (int i = 0; i < limbs; i++)
        to[i] = i < WIDE_LIMBS ? a.limb[i] : -(uint64_t)wide_negative(a);
}

#endif
