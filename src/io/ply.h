/* ply.h - the rows of .ply files, value by value; sparse points from them. */
#ifndef SF_IO_PLY_H
#define SF_IO_PLY_H

#include <stdint.h>

#include "../base/context.h"

/* A .ply that is being read: one of its elements, one row after the other. */
typedef struct sf_ply sf_ply;

/* Reads the file (`path` stays the caller's) and its header. On failure *ply is NULL. */
sf_status sf_ply_open(sf_context *ctx, const char *path, sf_ply **ply);
void sf_ply_close(sf_ply **ply);

/* Whether a comment says "SplatRenderMode: mip". */
int sf_ply_antialiased(const sf_ply *ply);
/* [3]: what a comment "origin X Y Z" says, to be added to all positions; else 0. */
const double *sf_ply_origin(const sf_ply *ply);
int sf_ply_has(const sf_ply *ply, const char *element);

/* Goes to the first row of an element, wherever in the file it is. As far as the file's size can tell, all
 * its rows are there: memory for sf_ply_rows may be allocated. SF_ERR_FORMAT: it is missing, or truncated;
 * SF_ERR_UNSUPPORTED: a list is among its properties. */
sf_status sf_ply_enter(sf_ply *ply, const char *element);

/* Of the element: its rows, and those of its properties whose names begin with `prefix`. */
size_t sf_ply_rows(const sf_ply *ply);
size_t sf_ply_properties(const sf_ply *ply, const char *prefix);
/* Whether it has that property, of type uchar. */
int sf_ply_is_byte(sf_ply *ply, const char *name);

/* Makes sf_ply_next put the element's property `name`, of whatever type, into values[target]. SF_ERR_FORMAT:
 * it is missing. */
sf_status sf_ply_bind(sf_ply *ply, const char *name, int target);

/* The next of sf_ply_rows; NaN stands for what a float cannot hold. Values without a property stay as they
 * are. SF_ERR_FORMAT: the text ends or is not a number. */
sf_status sf_ply_next(sf_ply *ply, float *values);
/* The same of doubles: what they hold, whatever it is. */
sf_status sf_ply_next_doubles(sf_ply *ply, double *values);
/* The same of 32-bit words, which floats would round. SF_ERR_FORMAT too: a value is none of 0..2^32 - 1. */
sf_status sf_ply_next_words(sf_ply *ply, uint32_t *words);

/* After the last row: says in the log how many bytes of the file no element announces. */
void sf_ply_report_rest(sf_ply *ply);

/* ply_points.c */
/* Reads the vertices of a .ply of any format: *xyz [n][3] and *rgb [n][3], both sf_free'd by the caller,
 * *count = n. Colours are the uchar properties red, green, blue, and 128 where a file has none. Points that
 * are not finite are the caller's to leave out. On failure *xyz and *rgb are NULL, *count is 0: SF_ERR_IO,
 * SF_ERR_FORMAT, SF_ERR_UNSUPPORTED (a list among the vertices' properties), SF_ERR_MEMORY. */
sf_status sf_ply_read_points(sf_context *ctx, const char *path, double **xyz, uint8_t **rgb, size_t *count);

#endif
