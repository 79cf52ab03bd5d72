/* create_context.c - makes and ends a context: memory, threads, kernels. */
#include "context.h"

#include <stdlib.h>
#include <string.h>

#include "../kernels/kernels.h"
#include "pool.h"

const char *sf_version(void) { return SF_VERSION; }

static sf_status choose_kernels(sf_context *ctx, const char *isa) {
    unsigned mask = sf_cpu_detect();
    if (!isa) isa = getenv("SPLATFIT_ISA");
    sf_status status = isa && *isa ? sf_cpu_choose(isa, &mask) : SF_OK;
    if (status) return status;
    ctx->kernels = sf_alloc(ctx, 1, sizeof *ctx->kernels);
    if (!ctx->kernels) return SF_ERR_MEMORY;
    sf_kernels_init(ctx->kernels, mask);
    return SF_OK;
}

sf_status sf_context_create(sf_context **context, const sf_context_options *options) {
    static const sf_context_options defaults = {0};
    *context = NULL;
    if (!options) options = &defaults;
    sf_allocator allocator = {0};
    if (options->allocator) allocator = *options->allocator;
    if (!allocator.alloc != !allocator.free) return SF_ERR_ARGUMENT;
    if (options->threads < 0 || options->threads > SF_MAX_THREADS) return SF_ERR_ARGUMENT;

    sf_context *ctx = sf_allocator_take(&allocator, sizeof *ctx);
    if (!ctx) return SF_ERR_MEMORY;
    memset(ctx, 0, sizeof *ctx);
    ctx->allocator = allocator;
    ctx->log = options->log;
    ctx->log_user = options->log_user;
    pthread_mutex_init(&ctx->lock, NULL);
    sf_status status = choose_kernels(ctx, options->isa);
    if (!status)
        status = sf_pool_create(ctx, options->threads ? options->threads : sf_usable_cpus(), &ctx->pool);
    *context = ctx;
    if (status) sf_context_destroy(context);
    return status;
}

void sf_context_destroy(sf_context **context) {
    sf_context *ctx = *context;
    if (!ctx) return;
    sf_pool_destroy(ctx, &ctx->pool);
    sf_free(ctx, ctx->kernels);
    pthread_mutex_destroy(&ctx->lock);
    sf_allocator allocator = ctx->allocator;
    sf_allocator_give(&allocator, ctx);
    *context = NULL;
}

int sf_context_threads(const sf_context *context) { return sf_pool_threads(context->pool); }

const char *sf_context_isa(const sf_context *context) { return context->kernels->isa; }

sf_status sf_kernel_describe(const sf_context *context, size_t index, sf_kernel_info *info) {
#define NAME(name) #name,
    static const char *const names[] = {SF_KERNELS(NAME)};
#undef NAME
    if (index >= SF_KERNEL_COUNT) return SF_ERR_END;
    *info = (sf_kernel_info){names[index], context->kernels->level[index]};
    return SF_OK;
}
