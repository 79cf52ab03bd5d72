/* libcamera.cc - frames from the cameras that libcamera knows; the one C++ file. No exception leaves it.
 *
 * A fixed set of requests goes round: queued in the camera, completed on libcamera's thread, which appends to
 * a list under a mutex, taken from there by sf_source_next, and queued again when the frame is given back.
 *
 * libcamera allows a process one CameraManager at a time and ends the process at the second. The context owns
 * the manager, for as long as any of its sources or lists needs it. That no other context of the process has
 * one is kept by the kernel: whoever makes a manager holds a lock on the process's own entry in /proc, of
 * which there is one a process, however often this library is in it, and which goes with the process. */
extern "C" {
#include "auto_exposure.h"
#include "dma_heaps.h"
#include "format.h"
#include "frame_order.h"
#include "jpeg_cut.h"
#include "libcamera.h"
#include "libcamera_format.h"
#include "libcamera_name.h"
}

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <vector>

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <libcamera/camera.h>
#include <libcamera/camera_manager.h>
#include <libcamera/control_ids.h>
#include <libcamera/formats.h>
#include <libcamera/framebuffer_allocator.h>
#include <libcamera/logging.h>
#include <libcamera/property_ids.h>
#include <libcamera/request.h>
#include <libcamera/version.h>

/* 0.0.3 is the oldest one that this was tried with. */
#if LIBCAMERA_VERSION_MAJOR == 0 && LIBCAMERA_VERSION_MINOR == 0 && LIBCAMERA_VERSION_PATCH < 3
#error "libcamera is older than 0.0.3"
#endif

/* 1. The manager of a context */

struct sf_libcamera {
    libcamera::CameraManager manager;
    int lock = -1;
    int users = 0;
};

namespace {

/* Runs what may throw. */
template <typename F> sf_status guarded(sf_context *ctx, F body) {
    try {
        return body();
    } catch (const std::bad_alloc &) {
        return sf_fail(ctx, SF_ERR_MEMORY, "libcamera: out of memory");
    } catch (const std::exception &e) {
        return sf_fail(ctx, SF_ERR_IO, "libcamera: %s", e.what());
    } catch (...) {
        return sf_fail(ctx, SF_ERR_IO, "libcamera: unknown exception");
    }
}

/* The process's lock; -1: another context has it. */
int lock_process() {
    int fd = open("/proc/self/stat", O_RDONLY | O_CLOEXEC);
    if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0) {
        close(fd);
        fd = -1;
    }
    return fd;
}

/* A share of the context's manager. */
class Manager {
  public:
    explicit Manager(sf_context *context) : ctx(context) {}
    Manager(const Manager &) = delete;
    Manager &operator=(const Manager &) = delete;
    ~Manager() {
        if (!shared) return;
        pthread_mutex_lock(&ctx->lock);
        if (--shared->users == 0) {
            ctx->libcamera = nullptr;
            stop(shared);
        }
        pthread_mutex_unlock(&ctx->lock);
    }

    /* Why there is none, or NULL. */
    const char *start() {
        const char *trouble = nullptr;
        pthread_mutex_lock(&ctx->lock);
        if (!ctx->libcamera) trouble = make();
        if (!trouble) {
            shared = ctx->libcamera;
            shared->users++;
        }
        pthread_mutex_unlock(&ctx->lock);
        return trouble;
    }

    libcamera::CameraManager &operator*() { return shared->manager; }
    libcamera::CameraManager *operator->() { return &shared->manager; }

  private:
    static void stop(sf_libcamera *made) {
        int lock = made->lock;
        made->manager.stop();
        delete made;
        close(lock);
    }

    const char *make() {
        int lock = lock_process();
        if (lock < 0) return "libcamera is in use by another context of this program";
        /* What it has to say goes where its user sends it; this library never prints. */
        if (!getenv("LIBCAMERA_LOG_FILE")) libcamera::logSetTarget(libcamera::LoggingTargetNone);
        sf_libcamera *made = new (std::nothrow) sf_libcamera;
        if (!made) {
            close(lock);
            return "out of memory";
        }
        made->lock = lock;
        if (made->manager.start() != 0) {
            stop(made);
            return "libcamera cannot be started";
        }
        ctx->libcamera = made;
        return nullptr;
    }

    sf_context *ctx;
    sf_libcamera *shared = nullptr;
};

/* 2. Formats */

using Format = sf_libcamera_format;

libcamera::PixelFormat pixel_of(const Format &format) { return libcamera::PixelFormat(format.fourcc); }

const Format *format_of(const libcamera::PixelFormat &pixel) {
    return pixel.modifier() ? nullptr : sf_libcamera_format_of(pixel.fourcc());
}

std::string words(const libcamera::Size &size) {
    return std::to_string(size.width) + "x" + std::to_string(size.height);
}

std::string list(const std::vector<libcamera::Size> &sizes) {
    std::string text;
    for (const libcamera::Size &size : sizes) text += (text.empty() ? "" : ", ") + words(size);
    return text.empty() ? "none" : text;
}

std::string list(const std::vector<libcamera::PixelFormat> &pixels) {
    std::string text;
    for (const libcamera::PixelFormat &pixel : pixels) {
        const Format *format = format_of(pixel);
        if (format) text += (text.empty() ? "" : ", ") + std::string(sf_pixel_format_name(format->format));
    }
    return text.empty() ? "no format that splatfit reads" : text;
}

std::string model_of(const libcamera::Camera &camera) {
    const auto model = camera.properties().get(libcamera::properties::Model);
    return model ? std::string(*model) : camera.id();
}

/* Why there is no memory for frames, after `what`. */
std::string with_heaps(std::string what) {
    char heaps[512];
    sf_dma_heaps_explain("/dev", heaps, sizeof heaps);
    return *heaps ? what + "; " + heaps : what;
}

/* What the camera would stream; NULL: it does not stream video. */
std::unique_ptr<libcamera::CameraConfiguration> configuration_of(libcamera::Camera &camera) {
    auto configuration = camera.generateConfiguration({libcamera::StreamRole::VideoRecording});
    if (!configuration || configuration->empty())
        configuration = camera.generateConfiguration({libcamera::StreamRole::Viewfinder});
    if (configuration && configuration->empty()) configuration.reset();
    return configuration;
}

using Devices = std::vector<dev_t>;

/* The devices behind a camera; none: not known. */
#if LIBCAMERA_VERSION_MAJOR == 0 && LIBCAMERA_VERSION_MINOR < 2
Devices devices_of(Manager &manager, const std::shared_ptr<libcamera::Camera> &camera) {
    const std::string root = "/sys/class/video4linux/";
    Devices found;
    DIR *nodes = opendir(root.c_str());
    while (const dirent *entry = nodes ? readdir(nodes) : nullptr) {
        FILE *file = fopen((root + entry->d_name + "/dev").c_str(), "re");
        unsigned a, b;
        if (file && fscanf(file, "%u:%u", &a, &b) == 2 && manager->get(makedev(a, b)) == camera)
            found.push_back(makedev(a, b));
        if (file) fclose(file);
    }
    if (nodes) closedir(nodes);
    return found;
}
#else
Devices devices_of(Manager &, const std::shared_ptr<libcamera::Camera> &camera) {
    Devices found;
    const auto devices = camera->properties().get(libcamera::properties::SystemDevices);
    if (devices)
        for (const int64_t device : *devices) found.push_back(dev_t(device));
    return found;
}
#endif

/* Whether the kernel still has them. */
bool present(const Devices &devices) {
    for (const dev_t device : devices) {
        char path[64];
        snprintf(path, sizeof path, "/sys/dev/char/%u:%u", major(device), minor(device));
        if (access(path, F_OK) != 0) return false;
    }
    return true;
}

/* 3. The source */

using Request = sf_libcamera_request;

/* A request that goes round, and where its buffer's planes are. */
struct Slot {
    std::unique_ptr<libcamera::Request> request;
    const libcamera::FrameBuffer *buffer;
    const uint8_t *plane[SF_FRAME_PLANES];
    size_t length[SF_FRAME_PLANES];
};

struct Mapping {
    void *memory;
    size_t bytes;
};

class Source {
  public:
    explicit Source(sf_context *its) : ctx(its), manager(its) {}
    Source(const Source &) = delete;
    Source &operator=(const Source &) = delete;
    ~Source() { shut(); }

    sf_context *context() const { return ctx; }
    sf_status open(const char *name);
    void describe(sf_source_info *info) const;
    sf_status next(int timeout_ms, bool newest, sf_frame *frame, sf_source_counts *counts);
    void release(sf_frame *frame) { queue(*static_cast<Slot *>(frame->lease)); }
    bool can_lock() const;
    void lock(bool so) { locked = so, lock_is_new = true; }

  private:
    sf_status fail(sf_status status, const char *what, int error = 0);
    sf_status find(const char *name, const Request &asked);
    sf_status choose(const Request &asked);
    sf_status adjust(const Request &asked);
    sf_status map();
    sf_status map_buffer(libcamera::FrameBuffer *buffer);
    template <typename T, typename V>
    sf_status want(const libcamera::Control<T> &control, const char *option, V value);
    sf_status want_controls(const Request &asked);
    void put_auto(libcamera::ControlList &to, const sf_auto_set &set) const;
    void put_controls(libcamera::ControlList &to) const;
    void put_lock(libcamera::ControlList &to) const;
    sf_status start();
    void shut();

    void completed(libcamera::Request *request) noexcept;
    void lost() noexcept;
    bool queue(Slot &slot);
    int32_t ahead(const Slot &slot) const;
    std::vector<Slot *>::iterator earliest();
    sf_status wait(std::chrono::steady_clock::time_point deadline, Slot **slot);
    bool whole(const Slot &slot) const;
    bool examine(Slot &slot, sf_source_counts *counts);
    void fill(Slot &slot, sf_frame *frame) const;

    sf_context *ctx;
    Manager manager;
    std::shared_ptr<libcamera::Camera> camera;
    std::unique_ptr<libcamera::CameraConfiguration> configuration;
    std::unique_ptr<libcamera::FrameBufferAllocator> allocator;
    libcamera::Stream *stream = nullptr;
    const Format *format = nullptr;
    int32_t width = 0, height = 0;
    size_t stride = 0;
    sf_yuv_matrix matrix = SF_YUV_601;
    int full_range = 0;
    std::string model;
    Devices devices;
    Request asked_for = {};
    bool acquired = false, running = false;
    bool locked = false, lock_is_new = false; /* goes with the next request */
    std::vector<Slot> slots;
    std::vector<Mapping> mappings;
    sf_frame_order order = {};

    std::mutex mutex; /* guards the following, which libcamera's thread changes */
    std::condition_variable changed;
    std::vector<Slot *> done; /* oldest first; never more than there are slots */
    size_t cancelled = 0;
    bool gone = false, said_gone = false;
};

sf_status Source::fail(sf_status status, const char *what, int error) {
    const char *which = camera ? camera->id().c_str() : "no camera";
    return error ? sf_fail(ctx, status, "libcamera: %s: %s: %s", which, what, strerror(std::abs(error)))
                 : sf_fail(ctx, status, "libcamera: %s: %s", which, what);
}

/* 3.1. Opening */

sf_status Source::find(const char *name, const Request &asked) {
    if (const char *trouble = manager.start()) return sf_fail(ctx, SF_ERR_IO, "%s: %s", name, trouble);
    const auto cameras = manager->cameras();
    bool number = strspn(asked.camera, "0123456789") == strlen(asked.camera);
    size_t index = number ? strtoul(asked.camera, nullptr, 10) : cameras.size();
    for (size_t i = 0; i < cameras.size(); i++)
        if (i == index || (!number && cameras[i]->id() == asked.camera)) camera = cameras[i];
    if (!camera) {
        /* A Raspberry Pi's are not even listed without a heap. */
        const std::string has = "it has " + std::to_string(cameras.size());
        return sf_fail(ctx, SF_ERR_IO, "%s: libcamera has no camera \"%s\"; %s", name, asked.camera,
                       cameras.empty() ? with_heaps(has).c_str() : has.c_str());
    }
    model = model_of(*camera);
    devices = devices_of(manager, camera);
    int error = camera->acquire();
    if (error == -EBUSY) return fail(SF_ERR_IO, "in use by another program, or twice by this one");
    if (error) return fail(SF_ERR_IO, "cannot be had", error);
    acquired = true;
    return SF_OK;
}

/* The format asked for; otherwise the first that we know which the camera has, the camera's own choice
 * before. */
sf_status Source::choose(const Request &asked) {
    configuration = configuration_of(*camera);
    if (!configuration) return fail(SF_ERR_UNSUPPORTED, "streams no video");
    libcamera::StreamConfiguration &c = configuration->at(0);
    const auto pixels = c.formats().pixelformats();
    const auto has = [&](const Format *f) {
        return f && std::find(pixels.begin(), pixels.end(), pixel_of(*f)) != pixels.end();
    };
    format = *asked.format ? sf_libcamera_format_named(asked.format) : format_of(c.pixelFormat);
    for (size_t i = 0; !*asked.format && !format && sf_libcamera_format_at(i); i++)
        if (has(sf_libcamera_format_at(i))) format = sf_libcamera_format_at(i);
    if (!format || (*asked.format && !pixels.empty() && !has(format)))
        return fail(SF_ERR_UNSUPPORTED,
                    ("format: has no " + std::string(*asked.format ? asked.format : "such format") +
                     "; it has " + list(pixels))
                        .c_str());
    return adjust(asked);
}

/* Lets libcamera make what is asked for possible, and refuses what comes out if it is something else. */
sf_status Source::adjust(const Request &asked) {
    libcamera::StreamConfiguration &c = configuration->at(0);
    c.pixelFormat = pixel_of(*format);
    if (asked.width) c.size = libcamera::Size(unsigned(asked.width), unsigned(asked.height));
    c.bufferCount = asked.buffers;
    const libcamera::Size size = c.size;
    if (configuration->validate() == libcamera::CameraConfiguration::Invalid)
        return fail(SF_ERR_UNSUPPORTED, "cannot be set to what is asked for");
    if (c.pixelFormat != pixel_of(*format))
        return fail(SF_ERR_UNSUPPORTED, ("format: gives " + c.pixelFormat.toString() + " instead").c_str());
    if (asked.width && c.size != size)
        return fail(SF_ERR_UNSUPPORTED,
                    /* What it lists may be but examples from a range. */
                    ("size: has no " + words(size) + ", but " + words(c.size) + "; it lists " +
                     list(c.formats().sizes(c.pixelFormat)))
                        .c_str());
    int error = camera->configure(configuration.get());
    if (error) return fail(SF_ERR_IO, "cannot be configured", error);
    stream = c.stream();
    width = int32_t(c.size.width);
    height = int32_t(c.size.height);
    stride = format->format == SF_PIXEL_MJPEG ? 0 : c.stride;
    if (format->format != SF_PIXEL_MJPEG && stride < size_t(width) * size_t(format->bytes))
        return fail(SF_ERR_UNSUPPORTED, ("stride: " + std::to_string(stride) + " is too short").c_str());
    if (c.colorSpace) {
        using libcamera::ColorSpace;
        matrix = c.colorSpace->ycbcrEncoding == ColorSpace::YcbcrEncoding::Rec709    ? SF_YUV_709
                 : c.colorSpace->ycbcrEncoding == ColorSpace::YcbcrEncoding::Rec2020 ? SF_YUV_2020
                                                                                     : SF_YUV_601;
        full_range = c.colorSpace->range == ColorSpace::Range::Full;
    }
    if (format->format == SF_PIXEL_MJPEG) full_range = 1; /* as JPEG has it */
    return SF_OK;
}

/* Planes may share a descriptor; each descriptor is mapped once. */
sf_status Source::map_buffer(libcamera::FrameBuffer *buffer) {
    Slot slot = {};
    slot.buffer = buffer;
    const auto &planes = buffer->planes();
    if (planes.size() < size_t(format->planes))
        return fail(SF_ERR_UNSUPPORTED, "has fewer planes than its format");
    std::map<int, const uint8_t *> mapped;
    for (int i = 0; i < format->planes; i++) {
        int fd = planes[size_t(i)].fd.get();
        off_t bytes = lseek(fd, 0, SEEK_END);
        size_t end = size_t(planes[size_t(i)].offset) + planes[size_t(i)].length;
        if (bytes < 0 || end > size_t(bytes) ||
            planes[size_t(i)].length < sf_libcamera_plane_bytes(format, stride, height, i))
            return fail(SF_ERR_UNSUPPORTED, "has a buffer that is shorter than a picture");
        if (!mapped.count(fd)) {
            void *memory = mmap(nullptr, size_t(bytes), PROT_READ, MAP_SHARED, fd, 0);
            if (memory == MAP_FAILED) return fail(SF_ERR_IO, "a buffer cannot be mapped", errno);
            mappings.push_back({memory, size_t(bytes)});
            mapped[fd] = static_cast<const uint8_t *>(memory);
        }
        slot.plane[i] = mapped[fd] + planes[size_t(i)].offset;
        slot.length[i] = planes[size_t(i)].length;
    }
    slot.request = camera->createRequest(slots.size());
    if (!slot.request) return fail(SF_ERR_IO, "gives no request");
    int error = slot.request->addBuffer(stream, buffer);
    if (error) return fail(SF_ERR_IO, "a buffer is refused", error);
    slots.push_back(std::move(slot));
    return SF_OK;
}

sf_status Source::map() {
    allocator = std::make_unique<libcamera::FrameBufferAllocator>(camera);
    int made = allocator->allocate(stream);
    if (made < 0)
        return fail(SF_ERR_IO,
                    with_heaps(std::string("gives no buffers: ") + strerror(std::abs(made))).c_str());
    for (const auto &buffer : allocator->buffers(stream)) {
        sf_status status = map_buffer(buffer.get());
        if (status != SF_OK) return status;
    }
    if (slots.size() < SF_SOURCE_MAX_LEASES)
        return fail(SF_ERR_UNSUPPORTED, "gives fewer buffers than frames may be out");
    done.reserve(slots.size());
    return SF_OK;
}

/* Whether the camera has a control, and takes this value of it. */
template <typename T, typename V>
sf_status Source::want(const libcamera::Control<T> &control, const char *option, V value) {
    const auto &controls = camera->controls();
    const auto found = controls.find(control.id());
    if (found == controls.end())
        return fail(SF_ERR_UNSUPPORTED, (std::string(option) + ": has no control for it").c_str());
    const libcamera::ControlValue least = found->second.min(), most = found->second.max();
    if (least.type() != most.type() || least.type() != libcamera::ControlValue(V(value)).type()) return SF_OK;
    if (value < least.get<V>() || value > most.get<V>())
        return fail(SF_ERR_ARGUMENT, (std::string(option) + ": " + std::to_string(value) + " is not from " +
                                      least.toString() + " to " + most.toString())
                                         .c_str());
    return SF_OK;
}

/* The modes came with 0.5. */
#if LIBCAMERA_VERSION_MAJOR > 0 || LIBCAMERA_VERSION_MINOR >= 5
#define HAVE_MODES 1
#else
#define HAVE_MODES 0
#endif

#if HAVE_MODES
/* Whether a mode can be both automatic and manual: a webcam's may be but one of them. */
bool switches(const libcamera::ControlInfoMap &known, const libcamera::ControlId &mode) {
    const auto found = known.find(mode.id());
    return found != known.end() && found->second.values().size() > 1;
}
#endif

sf_auto_has auto_of(const libcamera::Camera &camera) {
    namespace c = libcamera::controls;
    const auto &known = camera.controls();
    sf_auto_has has = {known.count(c::AeEnable.id()) != 0, 0, 0};
#if HAVE_MODES
    has.exposure_mode = switches(known, c::ExposureTimeMode);
    has.gain_mode = switches(known, c::AnalogueGainMode);
#endif
    return has;
}

sf_status Source::want_controls(const Request &asked) {
    namespace c = libcamera::controls;
    const sf_auto_has has = auto_of(*camera);
    sf_status status = SF_OK;
    if (asked.exposure_us < 0 && !has.enable && !has.exposure_mode)
        status = fail(SF_ERR_UNSUPPORTED, "exposure: has no automatic exposure");
    if (status == SF_OK && asked.exposure_us > 0)
        status = want(c::ExposureTime, "exposure", int32_t(asked.exposure_us));
    if (status == SF_OK && asked.gain > 0) status = want(c::AnalogueGain, "gain", float(asked.gain));
    if (status == SF_OK && asked.fps > 0)
        status = want(c::FrameDurationLimits, "fps", int64_t(std::llround(1e6 / asked.fps)));
    return status;
}

void Source::put_auto(libcamera::ControlList &to, const sf_auto_set &set) const {
    namespace c = libcamera::controls;
    if (set.enable != SF_AUTO_LEAVE) to.set(c::AeEnable, set.enable == SF_AUTO_ON);
#if HAVE_MODES
    if (set.exposure_mode != SF_AUTO_LEAVE)
        to.set(c::ExposureTimeMode,
               set.exposure_mode == SF_AUTO_ON ? c::ExposureTimeModeAuto : c::ExposureTimeModeManual);
    if (set.gain_mode != SF_AUTO_LEAVE)
        to.set(c::AnalogueGainMode,
               set.gain_mode == SF_AUTO_ON ? c::AnalogueGainModeAuto : c::AnalogueGainModeManual);
#endif
}

void Source::put_controls(libcamera::ControlList &to) const {
    namespace c = libcamera::controls;
    put_auto(to, sf_auto_open(auto_of(*camera), {asked_for.exposure_us, asked_for.gain}));
    if (asked_for.exposure_us > 0) to.set(c::ExposureTime, int32_t(asked_for.exposure_us));
    if (asked_for.gain > 0) to.set(c::AnalogueGain, float(asked_for.gain));
    if (asked_for.fps > 0) {
        const int64_t us = std::llround(1e6 / asked_for.fps);
        to.set(c::FrameDurationLimits, {us, us});
    }
}

bool Source::can_lock() const {
    const sf_auto_has has = auto_of(*camera);
    return has.enable || has.exposure_mode || has.gain_mode ||
           camera->controls().count(libcamera::controls::AwbEnable.id());
}

/* What was given by hand stays so when the rest is unlocked. */
void Source::put_lock(libcamera::ControlList &to) const {
    namespace c = libcamera::controls;
    put_auto(to, sf_auto_lock(auto_of(*camera), {asked_for.exposure_us, asked_for.gain}, locked));
    if (camera->controls().count(c::AwbEnable.id())) to.set(c::AwbEnable, !locked);
}

/* Some pipelines take controls with the start, some with the first request. */
sf_status Source::start() {
    camera->requestCompleted.connect(this, &Source::completed);
    camera->disconnected.connect(this, &Source::lost);
    libcamera::ControlList controls(camera->controls());
    put_controls(controls);
    int error = camera->start(&controls);
    if (error) return fail(SF_ERR_IO, "cannot be started", error);
    running = true;
    put_controls(slots[0].request->controls());
    for (Slot &slot : slots) {
        error = camera->queueRequest(slot.request.get());
        if (error) return fail(SF_ERR_IO, "a request is refused", error);
    }
    return SF_OK;
}

sf_status Source::open(const char *name) {
    sf_status status = sf_libcamera_read_name(ctx, name, &asked_for);
    if (status == SF_OK) status = find(name, asked_for);
    if (status == SF_OK) status = choose(asked_for);
    if (status == SF_OK) status = want_controls(asked_for);
    if (status == SF_OK) status = map();
    if (status == SF_OK) status = start();
    return status;
}

/* Requests must go before the buffers, these before the camera, and it before the manager, which is the first
 * member and goes last. Stopping returns the queued requests, cancelled; but a camera whose device is gone
 * cannot be stopped: libcamera ends the process where the driver does not return the buffers. What is done
 * instead is a call on libcamera's thread that is refused, as the camera is ours: it comes after all that was
 * queued there. */
void Source::shut() {
    if (running && present(devices))
        camera->stop();
    else if (running)
        camera->invokeMethod(&libcamera::Camera::acquire, libcamera::ConnectionTypeBlocking);
    if (camera) {
        camera->requestCompleted.disconnect(this);
        camera->disconnected.disconnect(this);
    }
    slots.clear();
    for (const Mapping &m : mappings) munmap(m.memory, m.bytes);
    allocator.reset();
    configuration.reset();
    if (acquired) camera->release();
    camera.reset();
}

void Source::describe(sf_source_info *info) const {
    info->width = width;
    info->height = height;
    info->format = format->format;
    info->frames_per_second = asked_for.fps;
    info->live = 1;
    info->can_lock_exposure = can_lock();
    snprintf(info->name, sizeof info->name, "%s, %dx%d %s", model.c_str(), int(width), int(height),
             sf_pixel_format_name(format->format));
}

/* 3.2. Frames; the next two are called on libcamera's thread. */

void Source::completed(libcamera::Request *request) noexcept {
    std::lock_guard<std::mutex> hold(mutex);
    if (request->status() == libcamera::Request::RequestCancelled)
        cancelled++;
    else
        done.push_back(&slots[request->cookie()]);
    changed.notify_one();
}

void Source::lost() noexcept {
    std::lock_guard<std::mutex> hold(mutex);
    gone = true;
    changed.notify_one();
}

/* Lets the camera have it again; 0: it takes nothing any more. */
bool Source::queue(Slot &slot) {
    slot.request->reuse(libcamera::Request::ReuseBuffers);
    if (lock_is_new) put_lock(slot.request->controls());
    lock_is_new = false;
    return camera->queueRequest(slot.request.get()) == 0;
}

/* By how many frames it is younger than the last one that was taken; 1: it follows. */
int32_t Source::ahead(const Slot &slot) const {
    return sf_frame_order_ahead(&order, slot.buffer->metadata().sequence);
}

std::vector<Slot *>::iterator Source::earliest() {
    return std::min_element(done.begin(), done.end(),
                            [this](const Slot *a, const Slot *b) { return ahead(*a) < ahead(*b); });
}

/* The completed request with the oldest picture. libcamera hands requests over in the order in which they
 * were queued, a whole batch at once if the first came last. That is not the order of the pictures where a
 * driver threw a bad one away and put its buffer behind the others: where a frame seems to lack, the rest of
 * the batch is awaited. */
sf_status Source::wait(std::chrono::steady_clock::time_point deadline, Slot **slot) {
    const auto batch = std::chrono::milliseconds(5);
    std::unique_lock<std::mutex> hold(mutex);
    changed.wait_until(hold, deadline, [this] { return !done.empty() || gone || cancelled == slots.size(); });
    if (!done.empty()) {
        changed.wait_for(hold, batch, [this] { return ahead(**earliest()) <= 1; });
        const auto first = earliest();
        *slot = *first;
        done.erase(first);
        return SF_OK;
    }
    if (!present(devices)) gone = true; /* udev may be slow, or not there */
    bool broken = gone || cancelled == slots.size(), say = broken && !said_gone;
    if (say) said_gone = true;
    hold.unlock();
    if (say) sf_log(ctx, SF_LOG_WARNING, "libcamera: %s is gone", camera->id().c_str());
    if (broken) return fail(SF_ERR_IO, "is gone");
    return fail(SF_ERR_TIMEOUT, "no frame came in time");
}

/* Bytes of a slot's JPEG; 0: it is none, or was cut off. */
size_t jpeg_bytes(const Slot &slot) {
    const size_t used = slot.buffer->metadata().planes()[0].bytesused;
    return sf_jpeg_end(slot.plane[0], std::min(used, slot.length[0]));
}

bool Source::whole(const Slot &slot) const {
    const libcamera::FrameMetadata &m = slot.buffer->metadata();
    if (m.status == libcamera::FrameMetadata::FrameError || m.planes().size() == 0) return false;
    if (format->format == SF_PIXEL_MJPEG) return jpeg_bytes(slot) != 0;
    /* Where the driver's buffer has one plane for all, so may have what it says of it. */
    size_t need = 0, has = 0;
    for (int i = 0; i < format->planes; i++) need += sf_libcamera_plane_bytes(format, stride, height, i);
    for (size_t i = 0; i < m.planes().size(); i++) has += m.planes()[i].bytesused;
    return has >= need;
}

/* Counts what was lost before and with this frame. Late and damaged frames are not given, but queued again.
 */
bool Source::examine(Slot &slot, sf_source_counts *counts) {
    if (!sf_frame_order_take(&order, slot.buffer->metadata().sequence, slots.size(), &counts->dropped)) {
        queue(slot);
        return false;
    }
    if (whole(slot)) return true;
    counts->damaged++;
    queue(slot);
    return false;
}

void Source::fill(Slot &slot, sf_frame *frame) const {
    namespace c = libcamera::controls;
    const libcamera::FrameMetadata &m = slot.buffer->metadata();
    const libcamera::ControlList &said = slot.request->metadata();
    for (int i = 0; i < format->planes; i++) {
        frame->plane[i] = slot.plane[i];
        frame->stride[i] = i ? stride / size_t(format->across) : stride;
    }
    if (format->format == SF_PIXEL_MJPEG) frame->bytes = jpeg_bytes(slot);
    frame->width = width;
    frame->height = height;
    frame->format = format->format;
    frame->matrix = matrix;
    frame->full_range = full_range;
    frame->sequence = order.sequence;
    /* The sensor's own time is the start of the exposure; drivers state it on the monotonic clock. */
    frame->time_ns = said.get(c::SensorTimestamp).value_or(int64_t(m.timestamp));
    /* Where a pipeline does not say what it did, what was asked for. */
    const double asked_us = asked_for.exposure_us > 0 ? asked_for.exposure_us : 0;
    const auto exposure_us = said.get(c::ExposureTime);
    const auto gain = said.get(c::AnalogueGain);
    frame->exposure_s = 1e-6 * (exposure_us ? double(*exposure_us) : asked_us);
    frame->gain = gain ? double(*gain) : asked_for.gain;
    frame->dmabuf = slot.buffer->planes()[0].fd.get();
    frame->lease = &slot;
}

sf_status Source::next(int timeout_ms, bool newest, sf_frame *frame, sf_source_counts *counts) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::milliseconds(timeout_ms);
    Slot *slot;
    do {
        sf_status status = wait(deadline, &slot);
        if (status != SF_OK) return status;
    } while (!examine(*slot, counts));
    while (newest) {
        {
            std::lock_guard<std::mutex> hold(mutex);
            if (done.empty()) break;
        }
        Slot *newer;
        sf_status status = wait(deadline, &newer);
        if (status != SF_OK) break;
        if (!examine(*newer, counts)) continue;
        queue(*slot);
        counts->skipped++;
        slot = newer;
    }
    fill(*slot, frame);
    return SF_OK;
}

/* 4. The seams to C */

void source_close(void *self) { delete static_cast<Source *>(self); }

void source_describe(const void *self, sf_source_info *info) {
    static_cast<const Source *>(self)->describe(info);
}

sf_status source_next(void *self, int timeout_ms, int newest, sf_frame *frame, sf_source_counts *counts) {
    Source *source = static_cast<Source *>(self);
    return guarded(source->context(), [&] { return source->next(timeout_ms, newest != 0, frame, counts); });
}

sf_status source_lock(void *self, int locked) {
    static_cast<Source *>(self)->lock(locked != 0);
    return SF_OK;
}

void source_release(void *self, sf_frame *frame) {
    try {
        static_cast<Source *>(self)->release(frame);
    } catch (...) { /* the request is lost; the others go on */
    }
}

sf_status add_camera(sf_devices *devices, libcamera::Camera &camera, size_t index) {
    sf_device_info info = {};
    std::string name = camera.id();
    if (name.size() + sizeof "libcamera:" > sizeof info.source || name.find('?') != std::string::npos)
        name = std::to_string(index);
    snprintf(info.source, sizeof info.source, "libcamera:%s", name.c_str());
    snprintf(info.name, sizeof info.name, "%s", model_of(camera).c_str());
    std::vector<sf_device_mode> modes;
    const auto configuration = configuration_of(camera);
    if (configuration) {
        const auto &formats = configuration->at(0).formats();
        for (const libcamera::PixelFormat &pixel : formats.pixelformats())
            for (const libcamera::Size &size : formats.sizes(pixel)) {
                const Format *format = format_of(pixel);
                const uint32_t fourcc = pixel.fourcc();
                sf_device_mode mode = {};
                for (int i = 0; i < 4; i++) mode.fourcc[i] = char(fourcc >> 8 * i);
                mode.supported = format != nullptr;
                if (format) mode.format = format->format;
                mode.width = int32_t(size.width);
                mode.height = int32_t(size.height);
                modes.push_back(mode);
            }
    }
    return sf_devices_add(devices, &info, modes.data(), modes.size());
}

} // namespace

extern "C" sf_status sf_libcamera_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {source_close, source_describe, source_next, source_release,
                                      source_lock};
    return guarded(ctx, [&] {
        auto made = std::make_unique<Source>(ctx);
        sf_status status = made->open(name);
        if (status != SF_OK) return status;
        source->ops = &ops;
        source->self = made.release();
        return SF_OK;
    });
}

extern "C" sf_status sf_libcamera_find(sf_context *ctx, sf_devices *devices) {
    return guarded(ctx, [&] {
        Manager manager(ctx);
        if (const char *trouble = manager.start()) {
            sf_log(ctx, SF_LOG_WARNING, "libcamera: %s: its cameras are not listed", trouble);
            return SF_OK;
        }
        sf_status status = SF_OK;
        const auto cameras = manager->cameras();
        for (size_t i = 0; status == SF_OK && i < cameras.size(); i++)
            status = add_camera(devices, *cameras[i], i);
        return status;
    });
}
