/* libcamera.cc - translates between libcamera's classes and the C structs of libcamera_source.h; the one C++
 * file. No exception leaves it. */
extern "C" {
#include "dma_heaps.h"
#include "libcamera.h"
#include "libcamera_manager.h"
#include "libcamera_source.h"
}

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <string>
#include <vector>

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

namespace {

/* 1. The manager of a context */

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

const char *start_manager(void **manager) {
    try {
        /* What it has to say goes where its user sends it; this library never prints. */
        if (!getenv("LIBCAMERA_LOG_FILE")) libcamera::logSetTarget(libcamera::LoggingTargetNone);
        auto made = std::make_unique<libcamera::CameraManager>();
        if (made->start() != 0) return "libcamera cannot be started";
        *manager = made.release();
        return nullptr;
    } catch (const std::bad_alloc &) {
        return "out of memory";
    } catch (...) {
        return "libcamera cannot be started";
    }
}

void stop_manager(void *manager) {
    auto made = static_cast<libcamera::CameraManager *>(manager);
    made->stop();
    delete made;
}

/* A share of the context's manager, which is given back when it goes. */
struct Unshare {
    sf_context *ctx;
    void operator()(libcamera::CameraManager *) const { sf_libcamera_unshare(ctx); }
};
using Manager = std::unique_ptr<libcamera::CameraManager, Unshare>;

/* NULL: none, with the reason. */
Manager share(sf_context *ctx, const char **trouble) {
    static const sf_libcamera_maker maker = {start_manager, stop_manager};
    void *shared = nullptr;
    *trouble = sf_libcamera_share(ctx, &maker, &shared);
    return Manager(static_cast<libcamera::CameraManager *>(shared), {ctx});
}

/* 2. What a camera offers */

/* 0: has a modifier, which no format of ours has. */
uint32_t fourcc_of(const libcamera::PixelFormat &pixel) { return pixel.modifier() ? 0 : pixel.fourcc(); }

std::string words(const libcamera::Size &size) {
    return std::to_string(size.width) + "x" + std::to_string(size.height);
}

std::string list(const std::vector<libcamera::Size> &sizes) {
    std::string text;
    for (const libcamera::Size &size : sizes) text += (text.empty() ? "" : ", ") + words(size);
    return text.empty() ? "none" : text;
}

std::string model_of(const libcamera::Camera &camera) {
    const auto model = camera.properties().get(libcamera::properties::Model);
    return model ? std::string(*model) : camera.id();
}

/* Why there is no memory for frames, to go on with. */
std::string and_heaps() {
    char heaps[512];
    sf_dma_heaps_explain("/dev", heaps, sizeof heaps);
    return *heaps ? std::string("; ") + heaps : "";
}

/* What the camera would stream; NULL: it does not stream video. */
std::unique_ptr<libcamera::CameraConfiguration> configuration_of(libcamera::Camera &camera) {
    auto configuration = camera.generateConfiguration({libcamera::StreamRole::VideoRecording});
    if (!configuration || configuration->empty())
        configuration = camera.generateConfiguration({libcamera::StreamRole::Viewfinder});
    if (configuration && configuration->empty()) configuration.reset();
    return configuration;
}

sf_yuv_matrix matrix_of(const libcamera::ColorSpace &space) {
    using Encoding = libcamera::ColorSpace::YcbcrEncoding;
    return space.ycbcrEncoding == Encoding::Rec709    ? SF_YUV_709
           : space.ycbcrEncoding == Encoding::Rec2020 ? SF_YUV_2020
                                                      : SF_YUV_601;
}

/* 3. Controls */

/* They came with 0.5. */
#define HAVE_MODES (LIBCAMERA_VERSION_MAJOR > 0 || LIBCAMERA_VERSION_MINOR >= 5)

#if HAVE_MODES
/* Whether a mode can be both automatic and manual: a webcam's may be but one of them. */
bool switches(const libcamera::ControlInfoMap &known, const libcamera::ControlId &mode) {
    const auto found = known.find(mode.id());
    return found != known.end() && found->second.values().size() > 1;
}
#endif

sf_libcamera_has has_of(const libcamera::Camera &camera) {
    namespace c = libcamera::controls;
    const auto &known = camera.controls();
    sf_libcamera_has has = {};
    has.enable = known.count(c::AeEnable.id()) != 0;
    has.white_balance = known.count(c::AwbEnable.id()) != 0;
#if HAVE_MODES
    has.exposure_mode = switches(known, c::ExposureTimeMode);
    has.gain_mode = switches(known, c::AnalogueGainMode);
#endif
    return has;
}

void put(libcamera::ControlList &to, const sf_libcamera_controls &set) {
    namespace c = libcamera::controls;
    if (set.enable != SF_AUTO_LEAVE) to.set(c::AeEnable, set.enable == SF_AUTO_ON);
    if (set.white_balance != SF_AUTO_LEAVE) to.set(c::AwbEnable, set.white_balance == SF_AUTO_ON);
#if HAVE_MODES
    if (set.exposure_mode != SF_AUTO_LEAVE)
        to.set(c::ExposureTimeMode,
               set.exposure_mode == SF_AUTO_ON ? c::ExposureTimeModeAuto : c::ExposureTimeModeManual);
    if (set.gain_mode != SF_AUTO_LEAVE)
        to.set(c::AnalogueGainMode,
               set.gain_mode == SF_AUTO_ON ? c::AnalogueGainModeAuto : c::AnalogueGainModeManual);
#endif
    if (set.exposure_us) to.set(c::ExposureTime, int32_t(set.exposure_us));
    if (set.gain > 0) to.set(c::AnalogueGain, float(set.gain));
    if (set.frame_us) to.set(c::FrameDurationLimits, {set.frame_us, set.frame_us});
}

/* 4. The camera behind a source */

class Camera {
  public:
    explicit Camera(sf_context *its) : ctx(its) {
        static const sf_libcamera_calls calls = {queue_again, close};
        source.device.ctx = its;
        source.device.id = "no camera";
        source.calls = &calls;
        source.camera = this;
    }
    ~Camera() { shut(); }

    sf_status open(const char *name);

    sf_libcamera_source source = {};

  private:
    sf_status find(const char *name);
    sf_status note_nodes();
    sf_status choose();
    sf_status adjust(const sf_libcamera_format &format);
    sf_status map();
    sf_status map_buffer(size_t index, libcamera::FrameBuffer *buffer);
    template <typename T, typename V>
    sf_status want(const libcamera::Control<T> &control, const char *option, V value);
    sf_status want_controls();
    sf_status start();
    void shut();
    sf_status fails(const char *what, int error = 0) {
        return sf_libcamera_fail(device, SF_ERR_IO, error, "%s", what);
    }

    static sf_status queue_again(void *camera, size_t buffer, const sf_libcamera_controls *set) noexcept;
    static void close(void *camera) noexcept { delete static_cast<Camera *>(camera); }
    void completed(libcamera::Request *request) noexcept;
    void lost() noexcept { sf_libcamera_queue_lose(&source.queue); }

    sf_context *const ctx;
    const sf_libcamera_device *const device = &source.device;
    Manager manager;
    std::shared_ptr<libcamera::Camera> camera;
    std::unique_ptr<libcamera::CameraConfiguration> configuration;
    std::unique_ptr<libcamera::FrameBufferAllocator> allocator;
    libcamera::Stream *stream = nullptr;
    std::vector<std::unique_ptr<libcamera::Request>> requests; /* each of the buffer of its number */
    bool acquired = false, running = false;
};

/* 4.1. Opening */

sf_status Camera::open(const char *name) {
    sf_status status = sf_libcamera_read_name(ctx, name, &source.asked);
    if (status == SF_OK) status = find(name);
    if (status == SF_OK) status = choose();
    if (status == SF_OK) status = want_controls();
    if (status == SF_OK) status = map();
    if (status == SF_OK) status = start();
    return status;
}

sf_status Camera::find(const char *name) {
    const char *trouble;
    manager = share(ctx, &trouble);
    if (trouble) return sf_fail(ctx, SF_ERR_IO, "%s: %s", name, trouble);
    const auto cameras = manager->cameras();
    for (size_t i = 0; i < cameras.size() && !camera; i++)
        if (sf_libcamera_is_meant(&source.asked, i, cameras[i]->id().c_str())) camera = cameras[i];
    /* A Raspberry Pi's are not even listed without a heap. */
    if (!camera)
        return sf_fail(ctx, SF_ERR_IO, "%s: libcamera has no camera \"%s\"; it has %zu%s", name,
                       source.asked.camera, cameras.size(), cameras.empty() ? and_heaps().c_str() : "");
    source.device.id = camera->id().c_str();
    snprintf(source.model, sizeof source.model, "%s", model_of(*camera).c_str());
    source.has = has_of(*camera);
    sf_status status = note_nodes();
    if (status != SF_OK) return status;
    int error = camera->acquire();
    acquired = !error;
    if (error == -EBUSY) return fails("in use by another program, or twice by this one");
    return error ? fails("cannot be had", error) : SF_OK;
}

/* The devices behind it. */
sf_status Camera::note_nodes() {
#if LIBCAMERA_VERSION_MAJOR == 0 && LIBCAMERA_VERSION_MINOR < 2
    const auto is_its = [](void *self, dev_t node) noexcept {
        Camera *its = static_cast<Camera *>(self);
        return int(its->manager->get(node) == its->camera);
    };
    return sf_libcamera_find_nodes(&source.device, "/sys/class/video4linux", is_its, this);
#else
    sf_status status = SF_OK;
    const auto nodes = camera->properties().get(libcamera::properties::SystemDevices);
    if (nodes)
        for (const int64_t node : *nodes)
            if (status == SF_OK) status = sf_libcamera_add_node(&source.device, dev_t(node));
    return status;
#endif
}

sf_status Camera::choose() {
    configuration = configuration_of(*camera);
    if (!configuration) return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "streams no video");
    const libcamera::StreamConfiguration &c = configuration->at(0);
    std::vector<uint32_t> fourccs;
    for (const libcamera::PixelFormat &pixel : c.formats().pixelformats())
        fourccs.push_back(fourcc_of(pixel));
    const sf_libcamera_offer offer = {fourcc_of(c.pixelFormat), fourccs.data(), fourccs.size()};
    const char *asked = source.asked.format;
    const sf_libcamera_format *format = sf_libcamera_format_choose(&offer, asked);
    if (format) return adjust(*format);
    char has[512];
    sf_libcamera_format_list(&offer, has, sizeof has);
    return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "format: has no %s; it has %s",
                             *asked ? asked : "such format", has);
}

/* Lets libcamera make what is asked for possible, and refuses what comes out if it is something else. */
sf_status Camera::adjust(const sf_libcamera_format &format) {
    const sf_libcamera_request &asked = source.asked;
    libcamera::StreamConfiguration &c = configuration->at(0);
    c.pixelFormat = libcamera::PixelFormat(format.fourcc);
    if (asked.width) c.size = libcamera::Size(unsigned(asked.width), unsigned(asked.height));
    c.bufferCount = asked.buffers;
    const libcamera::Size size = c.size;
    if (configuration->validate() == libcamera::CameraConfiguration::Invalid)
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "cannot be set to what is asked for");
    if (c.pixelFormat != libcamera::PixelFormat(format.fourcc))
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "format: gives %s instead",
                                 c.pixelFormat.toString().c_str());
    /* What it lists may be but examples from a range. */
    if (asked.width && c.size != size)
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "size: has no %s, but %s; it lists %s",
                                 words(size).c_str(), words(c.size).c_str(),
                                 list(c.formats().sizes(c.pixelFormat)).c_str());
    int error = camera->configure(configuration.get());
    if (error) return fails("cannot be configured", error);
    stream = c.stream();
    sf_libcamera_picture &picture = source.picture;
    picture.format = format.format;
    picture.width = int32_t(c.size.width);
    picture.height = int32_t(c.size.height);
    picture.stride = c.stride;
    if (c.colorSpace) {
        picture.matrix = matrix_of(*c.colorSpace);
        picture.full_range = c.colorSpace->range == libcamera::ColorSpace::Range::Full;
    }
    return SF_OK;
}

sf_status Camera::map() {
    allocator = std::make_unique<libcamera::FrameBufferAllocator>(camera);
    int made = allocator->allocate(stream);
    if (made < 0)
        return sf_libcamera_fail(device, SF_ERR_IO, 0, "gives no buffers: %s%s", strerror(std::abs(made)),
                                 and_heaps().c_str());
    const auto &buffers = allocator->buffers(stream);
    sf_status status = sf_libcamera_source_begin(&source, buffers.size());
    for (size_t i = 0; status == SF_OK && i < buffers.size(); i++) status = map_buffer(i, buffers[i].get());
    return status;
}

sf_status Camera::map_buffer(size_t index, libcamera::FrameBuffer *buffer) {
    std::vector<sf_libcamera_plane> planes;
    for (const auto &plane : buffer->planes()) planes.push_back({plane.fd.get(), plane.offset, plane.length});
    sf_status status =
        sf_libcamera_map(device, &source.picture, planes.data(), planes.size(), &source.buffers[index]);
    if (status != SF_OK) return status;
    requests.push_back(camera->createRequest(index));
    if (!requests.back()) return fails("gives no request");
    int error = requests.back()->addBuffer(stream, buffer);
    return error ? fails("a buffer is refused", error) : SF_OK;
}

/* Whether the camera has a control, and takes this value of it. */
template <typename T, typename V>
sf_status Camera::want(const libcamera::Control<T> &control, const char *option, V value) {
    const auto &controls = camera->controls();
    const auto found = controls.find(control.id());
    if (found == controls.end())
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "%s: has no control for it", option);
    const libcamera::ControlValue least = found->second.min(), most = found->second.max();
    if (least.type() != most.type() || least.type() != libcamera::ControlValue(V(value)).type()) return SF_OK;
    if (value < least.get<V>() || value > most.get<V>())
        return sf_libcamera_fail(device, SF_ERR_ARGUMENT, 0, "%s: %s is not from %s to %s", option,
                                 std::to_string(value).c_str(), least.toString().c_str(),
                                 most.toString().c_str());
    return SF_OK;
}

sf_status Camera::want_controls() {
    namespace c = libcamera::controls;
    const sf_libcamera_controls set = sf_libcamera_controls_open(source.has, &source.asked);
    sf_status status = sf_libcamera_check_auto(device, source.has, &source.asked);
    if (status == SF_OK && set.exposure_us)
        status = want(c::ExposureTime, "exposure", int32_t(set.exposure_us));
    if (status == SF_OK && set.gain > 0) status = want(c::AnalogueGain, "gain", float(set.gain));
    if (status == SF_OK && set.frame_us) status = want(c::FrameDurationLimits, "fps", set.frame_us);
    return status;
}

/* Some pipelines take controls with the start, some with the first request. */
sf_status Camera::start() {
    camera->requestCompleted.connect(this, &Camera::completed);
    camera->disconnected.connect(this, &Camera::lost);
    const sf_libcamera_controls set = sf_libcamera_controls_open(source.has, &source.asked);
    libcamera::ControlList controls(camera->controls());
    put(controls, set);
    int error = camera->start(&controls);
    if (error) return fails("cannot be started", error);
    running = true;
    put(requests[0]->controls(), set);
    for (const auto &request : requests) {
        error = camera->queueRequest(request.get());
        if (error) return fails("a request is refused", error);
    }
    return SF_OK;
}

/* Requests must go before the buffers, these before the camera, and it before the manager, which is declared
 * first and goes last. Stopping returns the queued requests, cancelled; but a camera whose device is gone
 * cannot be stopped: libcamera ends the process where the driver does not return the buffers. What is done
 * instead is a call on libcamera's thread that is refused, as the camera is ours: it comes after all that was
 * queued there. */
void Camera::shut() {
    if (running && sf_libcamera_present(&source.device))
        camera->stop();
    else if (running)
        camera->invokeMethod(&libcamera::Camera::acquire, libcamera::ConnectionTypeBlocking);
    if (camera) {
        camera->requestCompleted.disconnect(this);
        camera->disconnected.disconnect(this);
    }
    requests.clear();
    sf_libcamera_source_end(&source);
    allocator.reset();
    configuration.reset();
    if (acquired) camera->release();
    camera.reset();
}

/* 4.2. Frames */

/* On libcamera's thread. */
void Camera::completed(libcamera::Request *request) noexcept {
    namespace c = libcamera::controls;
    if (request->status() == libcamera::Request::RequestCancelled) {
        sf_libcamera_queue_cancel(&source.queue);
        return;
    }
    const libcamera::FrameMetadata &m = request->findBuffer(stream)->metadata();
    const libcamera::ControlList &said = request->metadata();
    const auto exposure_us = said.get(c::ExposureTime);
    const auto gain = said.get(c::AnalogueGain);
    sf_libcamera_filled filled = {};
    filled.buffer = request->cookie();
    filled.driver_sequence = m.sequence;
    filled.damaged = m.status == libcamera::FrameMetadata::FrameError || m.planes().size() == 0;
    filled.first_bytes = m.planes().size() ? m.planes()[0].bytesused : 0;
    for (const auto &plane : m.planes()) filled.bytes += plane.bytesused;
    /* The sensor's own time is the start of the exposure; drivers state it on the monotonic clock. */
    filled.time_ns = said.get(c::SensorTimestamp).value_or(int64_t(m.timestamp));
    filled.exposure_us = exposure_us ? double(*exposure_us) : -1;
    filled.gain = gain ? double(*gain) : -1;
    sf_libcamera_queue_put(&source.queue, &filled);
}

sf_status Camera::queue_again(void *self, size_t buffer, const sf_libcamera_controls *set) noexcept {
    Camera *its = static_cast<Camera *>(self);
    return guarded(its->ctx, [&] {
        libcamera::Request &request = *its->requests[buffer];
        request.reuse(libcamera::Request::ReuseBuffers);
        put(request.controls(), *set);
        its->camera->queueRequest(&request);
        return SF_OK;
    });
}

/* 5. The seams to C */

sf_status add_camera(sf_devices *devices, libcamera::Camera &camera, size_t index) {
    sf_device_info info = {};
    sf_libcamera_write_name(index, camera.id().c_str(), info.source, sizeof info.source);
    snprintf(info.name, sizeof info.name, "%s", model_of(camera).c_str());
    std::vector<sf_device_mode> modes;
    const auto configuration = configuration_of(camera);
    if (configuration) {
        const auto &formats = configuration->at(0).formats();
        for (const libcamera::PixelFormat &pixel : formats.pixelformats())
            for (const libcamera::Size &size : formats.sizes(pixel))
                modes.push_back(sf_libcamera_mode(pixel.fourcc(), pixel.modifier() != 0, int32_t(size.width),
                                                  int32_t(size.height)));
    }
    return sf_devices_add(devices, &info, modes.data(), modes.size());
}

} // namespace

extern "C" sf_status sf_libcamera_open(sf_context *ctx, const char *name, sf_source *source) {
    return guarded(ctx, [&] {
        auto made = std::make_unique<Camera>(ctx);
        sf_status status = made->open(name);
        if (status != SF_OK) return status;
        source->ops = &sf_libcamera_source_ops;
        source->self = &made.release()->source;
        return SF_OK;
    });
}

extern "C" sf_status sf_libcamera_find(sf_context *ctx, sf_devices *devices) {
    return guarded(ctx, [&] {
        const char *trouble;
        const Manager manager = share(ctx, &trouble);
        if (trouble) {
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
