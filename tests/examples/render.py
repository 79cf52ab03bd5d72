#!/usr/bin/env python3
"""render.py MODEL PICTURE.ppm - renders a model from Python, with nothing but ctypes.

The structs are those of include/splatfit/camera.h and render.h. The camera stands at the origin of the scene.
"""
import ctypes as c
import sys

WIDTH, HEIGHT = 320, 240


class Camera(c.Structure):
    _fields_ = [
        ("width", c.c_int32), ("height", c.c_int32),
        ("fx", c.c_double), ("fy", c.c_double), ("cx", c.c_double), ("cy", c.c_double),
        ("R_cw", c.c_double * 9), ("t_cw", c.c_double * 3),
    ]  # fmt: skip


class ImageOut(c.Structure):
    _fields_ = [("rgb", c.POINTER(c.c_float)), ("transmittance", c.c_void_p), ("depth", c.c_void_p)]


def load_library():
    """The library of the interface that these structs belong to."""
    sf = c.CDLL("libsplatfit.so.1")
    sf.sf_last_error.restype = sf.sf_status_text.restype = sf.sf_version.restype = c.c_char_p
    sf.sf_last_error.argtypes = [c.c_void_p]
    sf.sf_model_count.restype = c.c_size_t
    sf.sf_model_count.argtypes = [c.c_void_p]
    # Pointers are wider than the int that ctypes takes arguments for.
    sf.sf_model_load.argtypes = [c.c_void_p, c.c_char_p, c.c_void_p]
    sf.sf_renderer_create.argtypes = [c.c_void_p, c.c_void_p]
    sf.sf_render.argtypes = [c.c_void_p] * 5
    return sf


def main():
    if len(sys.argv) != 3:
        sys.exit("usage: render.py MODEL PICTURE.ppm")
    sf = load_library()
    context, model, renderer = c.c_void_p(), c.c_void_p(), c.c_void_p()

    def check(status):
        if status:
            message = sf.sf_last_error(context) if context else b""
            sys.exit("render.py: " + (message or sf.sf_status_text(status)).decode())

    check(sf.sf_context_create(c.byref(context), None))
    check(sf.sf_model_load(context, sys.argv[1].encode(), c.byref(model)))
    check(sf.sf_renderer_create(context, c.byref(renderer)))

    identity = (c.c_double * 9)(1, 0, 0, 0, 1, 0, 0, 0, 1)
    camera = Camera(WIDTH, HEIGHT, WIDTH, WIDTH, WIDTH / 2, HEIGHT / 2, identity, (c.c_double * 3)())
    pixels = (c.c_float * (WIDTH * HEIGHT * 3))()
    out = ImageOut(rgb=c.cast(pixels, c.POINTER(c.c_float)))
    check(sf.sf_render(renderer, model, c.byref(camera), None, c.byref(out)))

    with open(sys.argv[2], "wb") as file:
        file.write(b"P6 %d %d 255\n" % (WIDTH, HEIGHT))
        file.write(bytes(round(255 * min(max(value, 0), 1)) for value in pixels))
    print(f"{sf.sf_model_count(model)} Gaussians rendered by splatfit {sf.sf_version().decode()}")

    sf.sf_renderer_destroy(c.byref(renderer))
    sf.sf_model_destroy(c.byref(model))
    sf.sf_context_destroy(c.byref(context))


if __name__ == "__main__":
    main()
