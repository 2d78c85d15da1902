/* A filter's step as a list of operations whose number formats are data. Compiled once, for all designs.

   `prepare` finds the type of every operation from the formats, as numerics/quantise.py does; `run_formats`
   then computes all steps of all tracks on doubles, which are exact while sums and products fit 53 bits. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 32 };
#define EACH _Pragma("omp simd") for (int l = 0; l < LANES; l++)

/* In the order of explore/program.py. */
enum {
    INPUT, STATE, FLAG, CONSTANT, ROUNDED, BESIDE, ADD, SUBTRACT, MULTIPLY, SCALE, SHIFT, NEAR, QUOTIENT,
    FORM, QUANTISE, RECIPROCAL, DIVIDE, FUNCTION, TABLE, SELECT, NEGATIVE, AND, OR, NOT
};
enum { SINE, COSINE, SQUARE_ROOT, EXPONENTIAL, WRAP_TURN, ARCTANGENT, HYPOTENUSE };
enum { FLOOR, HALF_UP, HALF_EVEN, TOWARD_ZERO };
enum { SATURATE, WRAP };
enum { GUARD = 4, FUNCTION_GUARD = 2 };

typedef struct { double low, high; int32_t fraction, width; } type;
typedef struct { int32_t code, a, b, c, slot, matters; } operation;
typedef struct { int32_t width, fraction, is_signed, whole; } format;
/* A constant: its value, and the sums of the positive and the negative digits that it is multiplied by. */
typedef struct { double value, positive, negative, least; } constant;

typedef struct {
    int32_t count, states, outputs, inputs, flags, tables, rounding, overflow, index_bits, iterations;
    const operation *code;
    const constant *constants;
    const int32_t *state_leaves, *state_roots, *output_roots, *row_begin;
    const double *rows;
    const int32_t *reciprocals;
} program;

typedef struct {
    type t;
    int32_t at, leaves, live;
    double value, least, scale, unit;
} prepared;

static double power(int e) { return ldexp(1.0, e); }
static int bits_of(double integer) { int e; return integer > 0 ? (frexp(integer, &e), e) : 0; }
static int largest(int a, int b) { return a > b ? a : b; }

static int fraction_of(double value)
{
    int e;
    double m = frexp(value, &e);
    if (value == 0) return 0;
    int64_t raw = (int64_t)ldexp(m, 53);
    return 53 - e - __builtin_ctzll((uint64_t)(raw < 0 ? -raw : raw));
}

static type exact(double low, double high, int fraction)
{
    double scale = power(fraction);
    int width = largest(bits_of(high * scale), low < 0 ? bits_of(-low * scale - 1) : 0) + (low < 0);
    return (type){low, high, fraction, largest(width, 1)};
}

static type of_format(int width, int fraction, int is_signed)
{
    double unit = power(-fraction), half = power(width - is_signed);
    return (type){is_signed ? -half * unit : 0, (half - 1) * unit, fraction, width};
}

static double round_to(double value, double scale, double unit, int rounding)
{
    double x = value * scale;
    switch (rounding) {
    case FLOOR: return floor(x) * unit;
    case HALF_UP: return floor(x + 0.5) * unit;
    case HALF_EVEN: return rint(x) * unit;
    default: return trunc(x) * unit;
    }
}

static double clamp(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* The exact quotient rounded once, as arithmetic/division.py has it. */
static double divided(double a, double b, type form, int rounding)
{
    if (b == 0) return a < 0 ? form.low : form.high;
    double scale = power(form.fraction), dividend = a * scale, q = floor(dividend / b);
    if (q * b > dividend) q -= 1;
    if ((q + 1) * b <= dividend) q += 1;
    double rest = dividend - q * b;
    if (rounding == HALF_UP) q += 2 * rest >= b;
    if (rounding == HALF_EVEN) q += 2 * rest > b || (2 * rest == b && fmod(q, 2) != 0);
    if (rounding == TOWARD_ZERO) q += q < 0 && rest > 0;
    return clamp(q / scale, form.low, form.high);
}

/* A reciprocal from the table, refined by Newton steps: table_newton of arithmetic/division.py. */
static double looked_up(const program *p, double divisor, int divisor_fraction, type form)
{
    int64_t d = (int64_t)ldexp(divisor, divisor_fraction);
    if (d <= 0) return form.high;
    int k = p->index_bits, bits = 64 - __builtin_clzll((uint64_t)d), fraction = k + 2;
    int64_t index = (bits - 1 > k ? d >> (bits - 1 - k) : d << (k - bits + 1)) & ((1 << k) - 1);
    __int128 value = p->reciprocals[index];
    for (int i = 0; i < p->iterations; i++) {
        int target = 2 * fraction, most = largest(form.width + 2, k + 2);
        if (target > most) target = most;
        __int128 rest = ((__int128)1 << (bits + fraction + 1)) - (__int128)d * value;
        int kept = target + 2, dropped = bits + fraction - kept;
        __int128 factor = dropped > 0 ? rest >> dropped : rest << -dropped;
        value = (value * factor) >> (fraction + kept - target);
        fraction = target;
    }
    double raw = ldexp((double)(int64_t)value, form.fraction + divisor_fraction - bits - fraction);
    return clamp(ldexp(round_to(raw, 1, 1, p->rounding), -form.fraction), form.low, form.high);
}

static double inverted(const program *p, double divisor, type of, type form)
{
    return p->index_bits ? looked_up(p, divisor, of.fraction, form) : divided(1, divisor, form, p->rounding);
}

static type reciprocal_type(const program *p, const format *given, type divisor, double least)
{
    int width = given->width, fraction = given->fraction;
    if (!given->whole) {
        if (divisor.low > 0) least = divisor.low;
        /* What is given below the width are bits of headroom. */
        fraction -= (int)floor(log2(1 / least)) + (divisor.low > 0 ? 1 : 2);
    } else if (given->is_signed)
        width = largest(width - 1, 1);
    type form = of_format(width, fraction, 0);
    double unit = power(-fraction), smallest = divisor.low > 0 ? divisor.low : 0;
    double high = divided(1, smallest, form, p->rounding);
    double top = divisor.high > 0 ? divisor.high : power(-divisor.fraction);
    double low = divided(1, top, form, p->rounding);
    if (p->index_bits) {
        double slack = (floor(high / unit / power(p->index_bits)) + 1) * unit;
        low = low > slack ? low - slack : 0;
        high = high + slack < form.high ? high + slack : form.high;
    }
    return (type){low, high, fraction, width};
}

static double least_divisor(const program *p, type divisor, type form)
{
    double limit = of_format(form.width, form.fraction, 0).high;
    if (p->index_bits) limit *= 1 - power(-p->index_bits);
    double raw = ceil(power(divisor.fraction) / limit);
    return (raw > 1 ? raw : 1) * power(-divisor.fraction);
}

/* The format that a value is brought into: `_fitted` of numerics/quantise.py. */
static type fitted_form(const format *given, type value, int as_it_is)
{
    int width = given->width, fraction = given->fraction, is_signed = given->is_signed;
    if (as_it_is) return of_format(width, fraction, is_signed);
    if (value.low >= 0 && is_signed && !given->whole) {
        width = largest(width - 1, 1);
        is_signed = 0;
    }
    if (value.fraction < fraction) {
        if (given->whole) width = largest(1, width - (fraction - value.fraction));
        fraction = value.fraction;
    }
    return of_format(width, fraction, is_signed);
}

static type function_type(const operation *o, const format *given, type a, type b)
{
    int fraction = given->fraction + FUNCTION_GUARD;
    double top = power(given->width - given->fraction - given->is_signed);
    switch (o->c) {
    case SINE: case COSINE: return exact(-1, 1, largest(fraction, 1));
    case SQUARE_ROOT: return exact(0, a.high > 0 ? sqrt(a.high) : 0, given->fraction + 1);
    case EXPONENTIAL: return exact(0, top, fraction);
    case WRAP_TURN: return of_format(largest(a.fraction, 1), largest(a.fraction, 1), 1);
    case ARCTANGENT: return exact(-0.5, 0.5, largest(fraction, 1));
    default: return exact(0, hypot(fmax(-a.low, a.high), fmax(-b.low, b.high)), fraction);
    }
}

static void quantised_type(const program *p, prepared *all, int i)
{
    const operation *o = &p->code[i];
    prepared *r = &all[i], *x = &all[all[o->a].at];
    type form = all[o->b].t;
    double scale = power(form.fraction), unit = power(-form.fraction);
    int source = p->code[x - all].code;
    if (source == CONSTANT || source == ROUNDED || source == BESIDE) {
        double nearest = rint(x->value * scale) * unit;
        r->value = clamp(nearest, form.low, form.high);
        r->leaves = r->value != nearest;
        r->t = exact(r->value, r->value, fraction_of(r->value));
        return;
    }
    if (x->t.fraction <= form.fraction && form.low <= x->t.low && x->t.high <= form.high) {
        r->at = (int)(x - all);
        r->t = x->t;
        return;
    }
    double low = round_to(x->t.low, scale, unit, p->rounding), high = round_to(x->t.high, scale, unit, p->rounding);
    r->leaves = low < form.low || high > form.high;
    r->t = form;
    if (p->overflow == WRAP && r->leaves) return;
    r->t.low = clamp(low, form.low, form.high);
    r->t.high = clamp(high, form.low, form.high);
}

static void product_type(type *r, type a, type b)
{
    double x = a.low * b.low, y = a.low * b.high, z = a.high * b.low, w = a.high * b.high;
    *r = exact(fmin(fmin(x, y), fmin(z, w)), fmax(fmax(x, y), fmax(z, w)), a.fraction + b.fraction);
}

/* Whether two steps are one operation in the hardware: the same, or one value brought into the same format. */
static int same(const program *p, const prepared *all, int i, int j)
{
    if (i == j) return 1;
    if (p->code[i].code != QUANTISE || p->code[j].code != QUANTISE) return 0;
    type x = all[p->code[i].b].t, y = all[p->code[j].b].t;
    return all[p->code[i].a].at == all[p->code[j].a].at && x.fraction == y.fraction && x.low == y.low && x.high == y.high;
}

/* Whether y times `weighted` is y (w y) with w >= 0: `_is_weighted_square` of numerics/quantise.py. */
static int weighted_square(const program *p, const prepared *all, int y, int weighted)
{
    int inner = weighted;
    if (p->code[weighted].code == QUANTISE) {
        if (p->overflow == WRAP) return 0;
        inner = all[p->code[weighted].a].at;
    }
    if (p->code[inner].code != MULTIPLY) return 0;
    int a = all[p->code[inner].a].at, b = all[p->code[inner].b].at;
    if (same(p, all, y, a)) return all[b].t.low >= 0;
    return same(p, all, y, b) && all[a].t.low >= 0;
}

static void prepare(const program *p, const format *formats, prepared *all, double *rows)
{
    for (int i = 0; i < p->count; i++) {
        const operation *o = &p->code[i];
        const format *given = &formats[o->slot];
        prepared *r = &all[i], *x = &all[all[o->a].at], *y = &all[all[o->b].at], *z = &all[all[o->c].at];
        *r = (prepared){.at = i};
        switch (o->code) {
        case INPUT: case STATE: r->t = of_format(given->width, given->fraction, given->is_signed); break;
        case CONSTANT: case ROUNDED:
            r->value = p->constants[i].value;
            r->t = exact(r->value, r->value, fraction_of(r->value));
            break;
        case BESIDE: {
            int finest = y->t.fraction + GUARD;
            r->value = x->value;
            if (x->t.fraction > finest) r->value = round_to(x->value, power(finest), power(-finest), HALF_EVEN);
            r->t = exact(r->value, r->value, fraction_of(r->value));
            break;
        }
        case ADD: r->t = exact(x->t.low + y->t.low, x->t.high + y->t.high, largest(x->t.fraction, y->t.fraction)); break;
        case SUBTRACT:
            r->t = exact(x->t.low - y->t.high, x->t.high - y->t.low, largest(x->t.fraction, y->t.fraction));
            break;
        case MULTIPLY: {
            int a = (int)(x - all), b = (int)(y - all);
            product_type(&r->t, x->t, y->t);
            if (weighted_square(p, all, a, b) || weighted_square(p, all, b, a))
                r->t = exact(0, r->t.high, r->t.fraction);
            break;
        }
        case SCALE: {
            const constant *k = &p->constants[i];
            r->value = k->value;
            r->t = exact(k->positive * x->t.low - k->negative * x->t.high,
                         k->positive * x->t.high - k->negative * x->t.low, x->t.fraction + fraction_of(k->value));
            break;
        }
        case SHIFT:
            r->value = power(o->c);
            r->t = (type){x->t.low * r->value, x->t.high * r->value, x->t.fraction - o->c, x->t.width};
            break;
        case NEAR: r->at = (int)((x->t.width <= given->width + GUARD ? x : y) - all); r->t = all[r->at].t; break;
        case QUOTIENT: r->at = (int)((z->t.low <= 0 ? x : y) - all); r->t = all[r->at].t; break;
        case FORM: r->t = fitted_form(given, x->t, o->c); break;
        case QUANTISE: quantised_type(p, all, i); break;
        case RECIPROCAL:
            r->t = reciprocal_type(p, given, x->t, p->constants[i].least);
            r->least = least_divisor(p, x->t, r->t);
            r->leaves = x->t.low < r->least;
            break;
        case DIVIDE: r->t = of_format(given->width, given->fraction, given->is_signed); break;
        case FUNCTION: r->t = function_type(o, given, x->t, y->t); break;
        case TABLE: {
            type form = of_format(given->width, given->fraction, given->is_signed);
            double low = INFINITY, high = -INFINITY;
            int fraction = -4096;
            for (int k = p->row_begin[o->b]; k < p->row_begin[o->b + 1]; k++) {
                rows[k] = clamp(rint(p->rows[k] * power(form.fraction)) * power(-form.fraction), form.low, form.high);
                low = fmin(low, rows[k]);
                high = fmax(high, rows[k]);
                fraction = largest(fraction, fraction_of(rows[k]));
            }
            r->t = exact(low, high, fraction);
            break;
        }
        case SELECT:
            r->t = exact(fmin(y->t.low, z->t.low), fmax(y->t.high, z->t.high), largest(y->t.fraction, z->t.fraction));
            break;
        default: break;
        }
        r->scale = power(r->t.fraction);
        r->unit = power(-r->t.fraction);
    }
}

static int operand_count(int code)
{
    switch (code) {
    case INPUT: case STATE: case FLAG: case CONSTANT: case ROUNDED: case BESIDE: case FORM: return 0;
    case SCALE: case SHIFT: case QUANTISE: case RECIPROCAL: case TABLE: case NEGATIVE: case NOT: return 1;
    case SELECT: return 3;
    default: return 2;
    }
}

static int is_known(const program *p, const prepared *all, int i)
{
    const operation *o = &p->code[i];
    if (o->code == QUANTISE) return is_known(p, all, all[o->a].at);
    return o->code == CONSTANT || o->code == ROUNDED || o->code == BESIDE;
}

typedef double vector[LANES];

/* Marks what states and outputs need, sets their constants, and returns how many there are to compute in a
   step, their places in `order`. */
static int find_live(const program *p, prepared *all, int32_t *order, vector *v)
{
    for (int k = 0; k < p->states; k++) all[all[p->state_roots[k]].at].live = 1;
    for (int k = 0; k < p->outputs; k++) all[all[p->output_roots[k]].at].live = 1;
    for (int i = p->count - 1; i >= 0; i--) {
        const operation *o = &p->code[i];
        if (!all[i].live || is_known(p, all, i)) continue;
        int32_t operands[3] = {o->a, o->b, o->c};
        for (int k = 0; k < operand_count(o->code); k++) all[all[operands[k]].at].live = 1;
    }
    int count = 0;
    for (int i = 0; i < p->count; i++) {
        if (!all[i].live) continue;
        if (is_known(p, all, i))
            EACH v[i][l] = all[i].value;
        else
            order[count++] = i;
    }
    return count;
}

static double function_of(int function, double a, double b)
{
    const double turn = 6.283185307179586476925;
    switch (function) {
    case SINE: return sin(turn * a);
    case COSINE: return cos(turn * a);
    case SQUARE_ROOT: return sqrt(a > 0 ? a : 0);
    case EXPONENTIAL: return exp(a);
    case WRAP_TURN: return a - floor(a + 0.5);
    case ARCTANGENT: return atan2(a, b) / turn;
    default: return hypot(a, b);
    }
}

/* How many values were clamped, and how many of them for want of bits above the binary point: no such bit helps
   one that rounding has made negative and that has no sign. */
typedef struct { double all, beyond; } clamps;

/* Rounds and clamps a vector, and counts the lanes of `mask` that had to be clamped. */
static clamps quantise(double *restrict r, const double *restrict x, const prepared *form, int leaves,
                       const program *p, const double *restrict mask, double *restrict clamped)
{
    double scale = form->scale, unit = form->unit, low = form->t.low, high = form->t.high;
    double all = 0, beyond = 0, negative = low < 0;
    switch (p->rounding) {
    case FLOOR: EACH r[l] = floor(x[l] * scale) * unit; break;
    case HALF_UP: EACH r[l] = floor(x[l] * scale + 0.5) * unit; break;
    case HALF_EVEN: EACH r[l] = rint(x[l] * scale) * unit; break;
    default: EACH r[l] = trunc(x[l] * scale) * unit; break;
    }
    if (!leaves) return (clamps){0, 0};
    _Pragma("omp simd reduction(+ : all, beyond)")
    for (int l = 0; l < LANES; l++) {
        double above = r[l] > high ? mask[l] : 0.0, below = r[l] < low ? mask[l] : 0.0;
        all += above + below;
        beyond += above + negative * below;
        clamped[l] += above + below;
    }
    if (p->overflow == SATURATE) {
        EACH r[l] = r[l] < low ? low : r[l];
        EACH r[l] = r[l] > high ? high : r[l];
    } else {
        double span = high - low + unit;
        EACH r[l] = r[l] - span * floor((r[l] - low) / span);
    }
    return (clamps){all, beyond};
}

typedef struct {
    const program *p;
    const prepared *all;
    const double *rows;
    const int64_t *tracks;
    vector *v, *state, *input, *flag, masks[4];
    /* How often each lane was clamped where it counts: after a step with that it counts no more. */
    vector clamped;
    clamps *counts;
} machine;

static void leave(machine *m, clamps *count, int lane, int leaves, int beyond, const double *mask)
{
    double left = leaves ? mask[lane] : 0.0;
    m->clamped[lane] += left;
    count->all += left;
    count->beyond += beyond ? left : 0.0;
}

static void operate(machine *m, int i)
{
    const program *p = m->p;
    const operation *o = &p->code[i];
    const prepared *r = &m->all[i];
    double *restrict out = m->v[i];
    const double *restrict a = m->v[m->all[o->a].at], *restrict b = m->v[m->all[o->b].at];
    const double *restrict c = m->v[m->all[o->c].at];
    const double *mask = m->masks[o->matters];
    clamps count = {0, 0};
    double factor = r->value;
    switch (o->code) {
    case INPUT: {
        const double *in = m->input[o->a];
        double scale = r->scale, unit = r->unit, low = r->t.low, high = r->t.high;
        EACH out[l] = rint(in[l] * scale) * unit;
        for (int l = 0; l < LANES; l++) leave(m, &count, l, (out[l] < low) | (out[l] > high), 1, mask);
        EACH out[l] = clamp(out[l], low, high);
        break;
    }
    case STATE: memcpy(out, m->state[o->a], sizeof(vector)); break;
    case FLAG: memcpy(out, m->flag[o->a], sizeof(vector)); break;
    case ADD: EACH out[l] = a[l] + b[l]; break;
    case SUBTRACT: EACH out[l] = a[l] - b[l]; break;
    case MULTIPLY: EACH out[l] = a[l] * b[l]; break;
    case SCALE: case SHIFT: EACH out[l] = a[l] * factor; break;
    case QUANTISE: count = quantise(out, a, &m->all[o->b], r->leaves, p, mask, m->clamped); break;
    case RECIPROCAL: {
        type form = of_format(r->t.width, r->t.fraction, 0), of = m->all[m->all[o->a].at].t;
        for (int l = 0; l < LANES; l++) {
            out[l] = inverted(p, a[l], of, form);
            leave(m, &count, l, a[l] < r->least, a[l] > 0, mask);
        }
        break;
    }
    case DIVIDE:
        for (int l = 0; l < LANES; l++) {
            out[l] = divided(a[l], b[l], r->t, p->rounding);
            leave(m, &count, l, out[l] == r->t.high || out[l] == r->t.low, 1, mask);
        }
        break;
    case FUNCTION: {
        for (int l = 0; l < LANES; l++)
            out[l] = clamp(floor(function_of(o->c, a[l], b[l]) * r->scale) * r->unit, r->t.low, r->t.high);
        break;
    }
    case TABLE: {
        const double *rows = m->rows + p->row_begin[o->b];
        int last = p->row_begin[o->b + 1] - p->row_begin[o->b] - 1;
        for (int l = 0; l < LANES; l++) out[l] = rows[(int)clamp(a[l], 0, last)];
        break;
    }
    case SELECT: EACH out[l] = a[l] != 0 ? b[l] : c[l]; break;
    case NEGATIVE: EACH out[l] = a[l] < 0 ? 1.0 : 0.0; break;
    case AND: EACH out[l] = a[l] * b[l]; break;
    case OR: EACH out[l] = a[l] > b[l] ? a[l] : b[l]; break;
    case NOT: EACH out[l] = 1.0 - a[l]; break;
    default: break;
    }
    m->counts[i].all += count.all;
    m->counts[i].beyond += count.beyond;
}

/* The rows of LANES tracks at one step, and how many of them have one. `commands`: 0 no step, 1 a step, 2 one
   that counts. */
static int load(machine *m, const double *inputs, const uint8_t *flags, const uint8_t *commands, int64_t at,
                int64_t size, int64_t tracks, int64_t first, int starts, vector live)
{
    int many = 0;
    for (int l = 0; l < LANES; l++) {
        int inside = first + l < tracks;
        int64_t track = inside ? m->tracks[first + l] : 0;
        int command = inside ? commands[at + track] : 0;
        live[l] = command > 0;
        many += command > 0;
        for (int k = 0; k < m->p->inputs; k++) m->input[k][l] = inside ? inputs[k * size + at + track] : 0;
        for (int k = 0; k < m->p->flags; k++) m->flag[k][l] = inside ? flags[k * size + at + track] : 0;
        double counted = command == 2 && m->clamped[l] == 0, starting = m->flag[starts][l];
        m->masks[0][l] = 0;
        m->masks[1][l] = counted * starting;
        m->masks[2][l] = counted * (1 - starting);
        m->masks[3][l] = counted;
    }
    return many;
}

static void run_group(machine *m, const int32_t *order, int count, int64_t steps, int64_t tracks, int64_t first,
                      int starts, const double *inputs, const uint8_t *flags, const uint8_t *commands, double *outputs)
{
    const program *p = m->p;
    int64_t size = steps * tracks;
    vector live;
    memset(m->state, 0, sizeof(vector) * (size_t)p->states);
    memset(m->clamped, 0, sizeof(vector));
    for (int64_t s = 0; s < steps; s++) {
        if (!load(m, inputs, flags, commands, s * tracks, size, tracks, first, starts, live)) continue;
        for (int k = 0; k < count; k++) operate(m, order[k]);
        for (int k = 0; k < p->states; k++) {
            const double *next = m->v[m->all[p->state_roots[k]].at];
            double *kept = m->state[k];
            EACH kept[l] = live[l] != 0 ? next[l] : kept[l];
        }
        for (int k = 0; k < p->outputs; k++) {
            const double *value = m->v[m->all[p->output_roots[k]].at];
            double *row = outputs + k * size + s * tracks;
            for (int l = 0; l < LANES && first + l < tracks; l++) row[m->tracks[first + l]] = value[l];
        }
    }
}

/* The tracks by the step at which they end, so that those of one vector end together. Returns 0, or 1 without
   memory. */
static int sort_by_end(const uint8_t *commands, int64_t steps, int64_t tracks, int64_t *sorted)
{
    int64_t *ends = calloc((size_t)tracks, sizeof *ends), *from = calloc((size_t)steps + 2, sizeof *from);
    int failed = !ends || !from;
    if (!failed) {
        for (int64_t s = 0; s < steps; s++)
            for (int64_t t = 0; t < tracks; t++)
                if (commands[s * tracks + t]) ends[t] = s + 1;
        for (int64_t t = 0; t < tracks; t++) from[ends[t] + 1]++;
        for (int64_t s = 0; s < steps; s++) from[s + 1] += from[s];
        for (int64_t t = 0; t < tracks; t++) sorted[from[ends[t]]++] = t;
    }
    free(ends);
    free(from);
    return failed;
}

/* All steps of all tracks. Arrays: inputs, flags and outputs (k, steps, tracks), commands (steps, tracks).
   Where no track of a vector has a step, outputs stay as they are. Sets the types, and counts in which values were clamped where it matters. Returns 0, or 1 without memory. */
int run_formats(const program *p, const format *formats, int64_t steps, int64_t tracks, int32_t starts,
                const double *inputs, const uint8_t *flags, const uint8_t *commands, double *outputs, prepared *types,
                clamps *counts)
{
    size_t n = (size_t)p->count, vectors = n + (size_t)(p->states + p->inputs + p->flags);
    vector *all = aligned_alloc(64, sizeof(vector) * vectors);
    int32_t *order = malloc(sizeof(int32_t) * n);
    double *rows = malloc(sizeof(double) * (size_t)(p->row_begin[p->tables] + 1));
    int64_t *sorted = malloc(sizeof(int64_t) * (size_t)tracks);
    int failed = !all || !order || !rows || !sorted || sort_by_end(commands, steps, tracks, sorted);
    if (!failed) {
        machine m = {.p = p, .all = types, .rows = rows, .tracks = sorted, .v = all, .counts = counts};
        m.state = all + n;
        m.input = m.state + p->states;
        m.flag = m.input + p->inputs;
        prepare(p, formats, types, rows);
        int count = find_live(p, types, order, all);
        for (int64_t first = 0; first < tracks; first += LANES)
            run_group(&m, order, count, steps, tracks, first, starts, inputs, flags, commands, outputs);
    }
    free(all);
    free(order);
    free(rows);
    free(sorted);
    return failed;
}
