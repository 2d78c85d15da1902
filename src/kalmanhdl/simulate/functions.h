/* arithmetic/real_functions.py in C: the same operations in the same order, and so the same bits.

   The arrays of coefficients and the numbers in capitals come from there. */

#ifndef KALMANHDL_FUNCTIONS_H
#define KALMANHDL_FUNCTIONS_H

#define HORNER(coefficients, x) horner(coefficients, sizeof coefficients / sizeof *coefficients, x)

INLINE double horner(const double *coefficients, int count, double x)
{
    double total = coefficients[0];
    for (int k = 1; k < count; k++)
        total = total * x + coefficients[k];
    return total;
}

INLINE int is_finite(double x) { return __builtin_fabs(x) < __builtin_inf(); }

CALL double of_quarter(double turns, int quarters)
{
    if (!is_finite(turns))
        return __builtin_nan("");
    double rest = turns - __builtin_rint(turns), quarter = __builtin_rint(4 * rest);
    double t = (rest - 0.25 * quarter) * TURN, square = t * t;
    int which = ((int)quarter + quarters) & 3;
    double value = which & 1 ? 1 + square * HORNER(COSINE, square) : t + t * square * HORNER(SINE, square);
    return which >= 2 ? -value : value;
}

INLINE double sine(double turns) { return of_quarter(turns, 0); }
INLINE double cosine(double turns) { return of_quarter(turns, 1); }

INLINE double two_to_the(int exponent)
{
    union { uint64_t bits; double value; } power = {(uint64_t)(exponent + 1023) << 52};
    return power.value;
}

CALL double exponential(double x)
{
    if (x != x)
        return x;
    x = x > FARTHEST ? FARTHEST : x < -FARTHEST ? -FARTHEST : x;
    double whole = __builtin_rint(x * LOG2_E);
    double rest = (x - whole * LN2_HIGH) - whole * LN2_LOW;
    int first = (int)whole >> 1;
    return HORNER(EXPONENTIAL, rest) * two_to_the(first) * two_to_the((int)whole - first);
}

INLINE double wrap(double turns)
{
    if (!is_finite(turns))
        return __builtin_nan("");
    double rest = turns - __builtin_rint(turns);
    return rest == 0.5 ? -0.5 : rest;
}

CALL double arctangent(double height, double right)
{
    if (!is_finite(height) || !is_finite(right))
        return __builtin_nan("");
    double a = __builtin_fabs(height), b = __builtin_fabs(right);
    double low = a < b ? a : b, high = a < b ? b : a;
    if (high == 0)
        return 0.0;
    double slope = low / high, eighth = __builtin_rint(8 * slope), near = 0.125 * eighth;
    double d = (slope - near) / (1 + slope * near), square = d * d;
    double angle = EIGHTHS[(int)eighth] + (d + d * square * HORNER(ARCTANGENT, square)) * PER_RADIAN;
    angle = a > b ? 0.25 - angle : angle;
    angle = right < 0 ? 0.5 - angle : angle;
    return height < 0 ? -angle : angle;
}

CALL double hypotenuse(double a, double b)
{
    if (!is_finite(a) || !is_finite(b))
        return __builtin_fabs(a) + __builtin_fabs(b);
    a = __builtin_fabs(a), b = __builtin_fabs(b);
    double low = a < b ? a : b, high = a < b ? b : a;
    if (high == 0)
        return 0.0;
    double slope = low / high;
    return high * __builtin_sqrt(1 + slope * slope);
}

#endif
