/* sheet.h - the boards that splatfit prints: where their tags are, and what is black of them.
 *
 * 4 x 5 tags of tag36h11, numbers 0..19 in rows, a quarter of a tag between two: two of its cells, of which
 * one must be white. mm from the middle of the tags, +x right, +y down.
 */
#ifndef SF_SIM_SHEET_H
#define SF_SIM_SHEET_H

enum { SF_SHEET_COLUMNS = 4, SF_SHEET_ROWS = 5, SF_SHEET_TAGS = SF_SHEET_COLUMNS * SF_SHEET_ROWS };

typedef struct sf_sheet {
    const char *name;
    double width, height, tag; /* mm: the paper, and the side of a tag's black square */
} sf_sheet;

extern const sf_sheet sf_sheet_a4, sf_sheet_letter, sf_sheet_a3;

/* The middle of tag 0..19. */
void sf_sheet_tag(const sf_sheet *sheet, int tag, double *x, double *y);

/* Whether there is ink at a place; the ruler and the letters below the tags are left out. */
int sf_sheet_black(const sf_sheet *sheet, double x, double y);

/* Row `row` 0..7 of the cells of a tag: bit 7 is the left one, 1 where black. */
unsigned sf_sheet_cells(int tag, int row);

#endif
