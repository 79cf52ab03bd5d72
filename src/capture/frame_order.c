/* frame_order.c - see frame_order.h. */
#include "frame_order.h"

int32_t sf_frame_order_ahead(const sf_frame_order *order, uint32_t driver_sequence) {
    if (order->anew) return 1;
    return (int32_t)(driver_sequence - (order->counted ? order->driver_sequence : UINT32_MAX));
}

int sf_frame_order_take(sf_frame_order *order, uint32_t driver_sequence, size_t buffers, uint64_t *dropped) {
    int32_t step = sf_frame_order_ahead(order, driver_sequence);
    if (order->counted && step <= 0 && ++order->late < buffers) return 0;
    if (!order->counted || step <= 0) step = 1;
    *dropped += (uint64_t)(step - 1);
    order->sequence = order->counted ? order->sequence + (uint64_t)step : driver_sequence;
    order->driver_sequence = driver_sequence;
    order->counted = 1;
    order->anew = 0;
    order->late = 0;
    return 1;
}

void sf_frame_order_restart(sf_frame_order *order) { order->counted = order->anew = 1; }
