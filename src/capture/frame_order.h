/* frame_order.h - which frames of a driver's are late, how many were dropped between two, and a count beyond
 * its 32 bits. */
#ifndef SF_CAPTURE_FRAME_ORDER_H
#define SF_CAPTURE_FRAME_ORDER_H

#include <stddef.h>
#include <stdint.h>

/* All 0 to begin with. */
typedef struct sf_frame_order {
    int counted;              /* a frame came already, of this sequence: */
    uint64_t sequence;        /* as the source tells it: it never falls */
    int anew;                 /* the driver's begins anew with the next frame */
    uint32_t driver_sequence; /* the driver's own, which wraps and may begin anew */
    size_t late;              /* frames in a row that came after younger ones */
} sf_frame_order;

/* By how many frames it is younger than the last one that was taken; 1: it follows. */
int32_t sf_frame_order_ahead(const sf_frame_order *order, uint32_t driver_sequence);

/* Takes a frame, and adds what was lost before it to *dropped. 0: it is late, which the gap before the last
 * one counted; that as many frames as the driver has buffers are late means that it counts anew. With
 * buffers 1 no frame is late: a driver that does not count is counted for. */
int sf_frame_order_take(sf_frame_order *order, uint32_t driver_sequence, size_t buffers, uint64_t *dropped);

/* The driver was started again: how many frames were lost is unknown, and the next one is counted as the one
 * that follows. */
void sf_frame_order_restart(sf_frame_order *order);

#endif
