/* reconstruction.h - the cameras of a folder of photos, inside. */
#ifndef SF_SFM_RECONSTRUCTION_H
#define SF_SFM_RECONSTRUCTION_H

#include <splatfit/sfm.h>

#include "map.h"
#include "photos.h"

struct sf_reconstruction {
    sf_context *ctx;
    sf_photo_list list;
    sf_map *map;
    sf_map_camera *cameras; /* as the map began with */
    size_t camera_count;
    uint32_t *camera_of; /* [photos] */
    uint8_t *is_turned;  /* [photos]: on its side beside others of its camera; so are its pixels and poses */
    sf_map_picture *pictures; /* [photos]: what the map was made from */
    double seconds[SF_SFM_STAGES];
};

#endif
