/* splatfit.h - the whole public interface. */
#ifndef SPLATFIT_H
#define SPLATFIT_H

#include "calibrate.h"
#include "camera.h"
#include "cluster.h"
#include "context.h"
#include "file.h"
#include "fitter.h"
#include "live.h"
#include "model.h"
#include "path.h"
#include "prune.h"
#include "remap.h"
#include "render.h"
#include "scene.h"
#include "sfm.h"
#include "source.h"
#include "status.h"
#include "video.h"

#endif
