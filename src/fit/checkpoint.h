/* checkpoint.h - the table that writing and reading a checkpoint both follow, and what they share.
 *
 * A fit that continues from a checkpoint gives the same bytes as one that was never interrupted. So a
 * checkpoint holds all state that a step reads and does not recompute. A new scalar of the fitter needs one
 * line in the lists below, a new array one in put_state (checkpoint_write.c) and one in take_state
 * (checkpoint_read.c).
 */
#ifndef SF_FIT_CHECKPOINT_H
#define SF_FIT_CHECKPOINT_H

#include "../io/sections.h"
#include "fitter.h"

/* Beyond any number of steps, Gaussians or views; a double holds it, and sums of it do not overflow. */
#define SF_CHECKPOINT_MOST 0x1p53

enum { OPTION_TEXT = 64, MOST_TEXT = 1 << 16, MOST_NAMES = 1 << 28, CAMERA_VALUES = 16, VIEW_VALUES = 3 };
enum { MERGE_WORDS = sizeof(sf_merge) / sizeof(uint32_t) };

/* Scalars of the fitter, by kind. */
#define STATE_INTEGERS(F)                                                                                    \
    F(step)                                                                                                  \
    F(level)                                                                                                 \
    F(sh_degree)                                                                                             \
    F(skipped_values)                                                                                        \
    F(warm_start)                                                                                            \
    F(first_count)                                                                                           \
    F(densify.out_of_memory)                                                                                 \
    F(densify.ended)                                                                                         \
    F(select.vain_growths)                                                                                   \
    F(sampler.at)                                                                                            \
    F(trace.replayed)                                                                                        \
    F(trace.lost)                                                                                            \
    F(validation.assigned)                                                                                   \
    F(validation.next_step)                                                                                  \
    F(validation.best_step)                                                                                  \
    F(validation.merged)                                                                                     \
    F(blur.judged)                                                                                           \
    F(misplaced.judged)                                                                                      \
    F(merges.in_vain)                                                                                        \
    F(select.min_error_level)                                                                                \
    F(end)                                                                                                   \
    F(optimizer_restart)                                                                                     \
    F(recovery.since)                                                                                        \
    F(sampler.views_before)                                                                                  \
    F(recovery.count)
#define STATE_REALS(F)                                                                                       \
    F(extent)                                                                                                \
    F(near_plane)                                                                                            \
    F(steps_per_second)                                                                                      \
    F(validation.best_fraction)                                                                              \
    F(validation.next_fraction)                                                                              \
    F(cool_down.from)                                                                                        \
    F(select.noise_variance)                                                                                 \
    F(select.growth_scale)                                                                                   \
    F(merges.part)                                                                                           \
    F(merges.squares)                                                                                        \
    F(select.min_error)                                                                                      \
    F(cool_down.length)                                                                                      \
    F(recovery.min_loss)                                                                                     \
    F(recovery.initial_loss)                                                                                 \
    F(recovery.lr_scale)                                                                                     \
    F(sampler.start)

#define COUNT_ONE(name) +1
enum { INTEGERS = 0 STATE_INTEGERS(COUNT_ONE), REALS = 0 STATE_REALS(COUNT_ONE) };
#undef COUNT_ONE

/* Only in what several ranks wrote: [ranks][SF_BANDS] Gaussians of the model with each band, then of the
 * restore point, all 0 where there is none. */
#define SF_CHECKPOINT_RANKS "ranks"

/* Kind and version of the file. */
extern const sf_sections_kind sf_checkpoint_kind;

/* SF_ERR_FORMAT: "PATH: section SECTION: WHAT". */
sf_status sf_checkpoint_bad(const sf_sections_in *in, const char *section, const char *what);

/* Name of the section of a field: "PREFIX.FIELD". */
typedef struct sf_checkpoint_field {
    char text[SF_SECTION_NAME];
} sf_checkpoint_field;
sf_checkpoint_field sf_checkpoint_name(const char *prefix, int field);

/* Number of values of a field, and of a part of its optimizer state, in whole blocks: the lanes behind the
 * last Gaussian are stored, too. */
size_t sf_checkpoint_values(const sf_model *model, int field);
size_t sf_checkpoint_moments(const sf_optimizer_state *state, int part, const sf_model *model, int field);

/* checkpoint_views.c: the scene's views, to recognise the scene; and the learned values of each view. Reading
 * fails with SF_ERR_ARGUMENT where the scene is another one, SF_ERR_FORMAT, SF_ERR_MEMORY. */
sf_status sf_checkpoint_put_scene(sf_sections_out *out, const sf_fitter *fitter);
sf_status sf_checkpoint_take_scene(sf_sections_in *in, sf_fitter *fitter);
sf_status sf_checkpoint_put_learned(sf_sections_out *out, const sf_fitter *fitter);
sf_status sf_checkpoint_take_learned(sf_sections_in *in, sf_fitter *fitter);

#endif
