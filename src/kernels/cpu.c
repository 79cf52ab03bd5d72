/* cpu.c - which levels this machine has. */
#include "kernels.h"

#include <string.h>

#include <splatfit/context.h>

#if defined(__arm__) || defined(__aarch64__)
#include <sys/auxv.h>
#endif

/* Lowest first; a level includes those before it of the same machine, and what some of its processors add. */
static const struct {
    const char *name;
    unsigned bit, added;
} levels[] = {
    {"scalar", 0, 0},
    {"sse4", SF_CPU_SSE4, 0},
    {"avx2", SF_CPU_AVX2, 0},
    {"avx512", SF_CPU_AVX512, SF_CPU_VNNI},
    {"neon", SF_CPU_NEON, SF_CPU_DOT},
};

enum { LEVELS = sizeof levels / sizeof *levels };

unsigned sf_cpu_detect(void) {
    unsigned mask = 0;
#if defined(__x86_64__) || defined(__i386__)
    /* the compiler's run-time asks the processor, and the system whether it saves the registers */
    __builtin_cpu_init();
    if (__builtin_cpu_supports("sse4.1")) mask |= SF_CPU_SSE4;
    if (mask && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) mask |= SF_CPU_AVX2;
    if (mask & SF_CPU_AVX2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        mask |= SF_CPU_AVX512;
    if (mask & SF_CPU_AVX512 && __builtin_cpu_supports("avx512vnni")) mask |= SF_CPU_VNNI;
#elif defined(__aarch64__)
    enum { ASIMDDP = 1 << 20 }; /* AT_HWCAP of 64-bit ARM */
    mask = SF_CPU_NEON;         /* part of the architecture */
    if (getauxval(AT_HWCAP) & ASIMDDP) mask |= SF_CPU_DOT;
#elif defined(__arm__)
    enum { NEON = 1 << 12, VFP4 = 1 << 16 }; /* AT_HWCAP of 32-bit ARM */
    unsigned long has = getauxval(AT_HWCAP);
    if (has & NEON && has & VFP4) mask = SF_CPU_NEON;
#endif
    return mask;
}

#if defined(__x86_64__) || defined(__i386__)
static const unsigned built = SF_CPU_SSE4 | SF_CPU_AVX2 | SF_CPU_AVX512;
#elif defined(__arm__) || defined(__aarch64__)
static const unsigned built = SF_CPU_NEON;
#else
static const unsigned built = 0;
#endif

sf_status sf_isa_describe(size_t index, sf_isa_info *info) {
    if (index >= LEVELS) return SF_ERR_END;
    unsigned bit = levels[index].bit;
    *info = (sf_isa_info){levels[index].name, !bit || (built & bit), !bit || (sf_cpu_detect() & bit)};
    return SF_OK;
}

sf_status sf_cpu_choose(const char *name, unsigned *mask) {
    for (size_t i = 0; i < LEVELS; i++) {
        unsigned bit = levels[i].bit, has = sf_cpu_detect();
        if (strcmp(levels[i].name, name)) continue;
        if (bit && !(has & bit)) return SF_ERR_UNSUPPORTED;
        *mask = bit ? has & (bit | (bit - 1) | levels[i].added) : 0;
        return SF_OK;
    }
    return SF_ERR_ARGUMENT;
}
