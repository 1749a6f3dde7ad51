/* A C library whose elementary functions are a unit in the last place higher, for LD_PRELOAD: what calls them gives
   other bits. Results that are whole numbers stay, since every library has those. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>

static double moved(double value) { return isfinite(value) && value != rint(value) ? nextafter(value, INFINITY) : value; }

#define ONE(name)                                                     \
    double name(double x) {                                           \
        static double (*real)(double);                                \
        if (!real) real = (double (*)(double))dlsym(RTLD_NEXT, #name); \
        return moved(real(x));                                        \
    }
#define TWO(name)                                                                     \
    double name(double x, double y) {                                                 \
        static double (*real)(double, double);                                        \
        if (!real) real = (double (*)(double, double))dlsym(RTLD_NEXT, #name);        \
        return moved(real(x, y));                                                     \
    }

ONE(acos) ONE(acosh) ONE(asin) ONE(asinh) ONE(atan) ONE(atanh) ONE(cbrt) ONE(cos) ONE(cosh) ONE(erf) ONE(erfc)
ONE(exp) ONE(exp2) ONE(expm1) ONE(lgamma) ONE(log) ONE(log10) ONE(log1p) ONE(log2) ONE(sin) ONE(sinh) ONE(tan)
ONE(tanh) ONE(tgamma) TWO(atan2) TWO(hypot) TWO(pow)

void sincos(double x, double *s, double *c) {
    *s = sin(x);
    *c = cos(x);
}
