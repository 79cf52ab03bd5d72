/* render_circle.c - renders a model from a circle about its middle: render_circle MODEL FOLDER [PICTURES].
 *
 * The middle and the size are the median mean and distance, and up is -y, as where a camera was held upright
 * first.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <splatfit/splatfit.h>

enum { WIDTH = 320, HEIGHT = 240 };

static int by_value(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The median of n > 0 values, which are sorted. */
static double median(float *values, size_t n) {
    qsort(values, n, sizeof *values, by_value);
    return (double)values[n / 2];
}

static sf_status find_middle(const sf_model *model, double middle[3], double *radius) {
    size_t n = sf_model_count(model);
    if (!n) return SF_ERR_EMPTY;
    float *means = malloc(n * 4 * sizeof *means), *values = means + 3 * n;
    if (!means) return SF_ERR_MEMORY;
    sf_status status = sf_model_get(model, 0, n, &(sf_gaussians){.means = means});
    for (int k = 0; k < 3 && !status; k++) {
        for (size_t i = 0; i < n; i++) values[i] = means[3 * i + (size_t)k];
        middle[k] = median(values, n);
    }
    for (size_t i = 0; i < n && !status; i++) {
        double squares = 0;
        for (size_t k = 0; k < 3; k++) squares += pow((double)means[3 * i + k] - middle[k], 2);
        values[i] = (float)sqrt(squares);
    }
    if (!status) *radius = median(values, n);
    free(means);
    return status;
}

/* A camera at an angle (radians) of the level circle that looks at the middle. The rows of its rotation are
 * right, down and forward. */
static sf_camera camera_at(const double middle[3], double distance, double angle) {
    const double c = cos(angle), s = sin(angle);
    const double center[3] = {middle[0] + distance * c, middle[1] + distance * s, middle[2]};
    sf_camera camera = {.width = WIDTH,
                        .height = HEIGHT,
                        .fx = WIDTH / 2.0,
                        .fy = WIDTH / 2.0,
                        .cx = WIDTH / 2.0,
                        .cy = HEIGHT / 2.0,
                        .R_cw = {-s, c, 0, 0, 0, -1, -c, -s, 0}};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) camera.t_cw[i] -= camera.R_cw[3 * i + k] * center[k];
    return camera;
}

static sf_status render(sf_context *ctx, const sf_model *model, const char *folder, int pictures) {
    static float rgb[HEIGHT][WIDTH][3];
    const sf_image_out out = {.rgb = &rgb[0][0][0]};
    sf_renderer *renderer = NULL;
    double middle[3], radius = 1;
    char path[4096];
    sf_status status = find_middle(model, middle, &radius);
    if (!status) status = sf_renderer_create(ctx, &renderer);
    for (int i = 0; i < pictures && !status; i++) {
        sf_camera camera = camera_at(middle, radius, 6.283185307179586 * i / pictures);
        snprintf(path, sizeof path, "%s/%03d.png", folder, i);
        status = sf_render(renderer, model, &camera, NULL, &out);
        if (!status) status = sf_write_png(ctx, path, WIDTH, HEIGHT, out.rgb);
    }
    sf_renderer_destroy(&renderer);
    return status;
}

int main(int argc, char **argv) {
    sf_context *ctx = NULL;
    sf_model *model = NULL;
    if (argc < 3) {
        fprintf(stderr, "usage: render_circle MODEL FOLDER [PICTURES]\n");
        return 2;
    }
    sf_status status = sf_context_create(&ctx, NULL);
    if (!status) status = sf_model_load(ctx, argv[1], &model);
    if (!status) status = render(ctx, model, argv[2], argc > 3 ? atoi(argv[3]) : 60);
    if (status)
        fprintf(stderr, "render_circle: %s\n",
                ctx && *sf_last_error(ctx) ? sf_last_error(ctx) : sf_status_text(status));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return status != SF_OK;
}
