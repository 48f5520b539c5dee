#include "filters/learned/oidn_library.h"

#include <stdexcept>

#ifdef BRUME_OIDN_LIBRARY
#include <OpenImageDenoise/oidn.h>

#include <memory>
#include <vector>

namespace brume {
namespace {

/// Three floats for each pixel, as the library reads them.
std::vector<float> interleaved(const RgbPlanes& planes) {
  std::vector<float> values;
  for (int y = 0; y < planes[0]->height(); ++y)
    for (int x = 0; x < planes[0]->width(); ++x)
      for (const Plane* plane : planes) values.push_back((*plane)(x, y));
  return values;
}

class Library {
 public:
  Library(int width, int height, int quality, const Task& task)
      : width_(static_cast<size_t>(width)), height_(static_cast<size_t>(height)), task_(task) {
    constexpr int kQualities[] = {OIDN_QUALITY_HIGH, OIDN_QUALITY_BALANCED,
                                  OIDN_VERSION >= 20300 ? 4 : OIDN_QUALITY_BALANCED};
    quality_ = kQualities[quality];
    if (task.threads > 0) oidnSetDeviceInt(device_.get(), "numThreads", task.threads);
    oidnSetDeviceBool(device_.get(), "setAffinity", false);
    oidnCommitDevice(device_.get());
    check();
  }

  struct Image {
    const char* name;
    std::vector<float>* values;
  };
  /// Cleans the first of some images.
  std::vector<float> clean(std::initializer_list<Image> images, bool hdr, bool clean_features, double begin,
                           double end) const {
    const Task part = share(task_, begin, end);
    const std::unique_ptr<OIDNFilterImpl, decltype(&oidnReleaseFilter)> filter(oidnNewFilter(device_.get(), "RT"),
                                                                               &oidnReleaseFilter);
    std::vector<float> out(images.begin()->values->size());
    const auto set = [&](const char* name, std::vector<float>& values) {
      oidnSetSharedFilterImage(filter.get(), name, values.data(), OIDN_FORMAT_FLOAT3, width_, height_, 0, 0, 0);
    };
    for (const Image& image : images)
      if (!image.values->empty()) set(image.name, *image.values);
    set("output", out);
    if (hdr) oidnSetFilterBool(filter.get(), "hdr", true);
    if (clean_features) oidnSetFilterBool(filter.get(), "cleanAux", true);
    oidnSetFilterInt(filter.get(), "quality", quality_);
    oidnSetFilterInt(filter.get(), "maxMemoryMB", 1000);
    const auto tell = [](void* whom, double fraction) {
      const Task& asked = *static_cast<const Task*>(whom);
      asked.report(fraction);
      return !asked.cancelled();
    };
    oidnSetFilterProgressMonitorFunction(filter.get(), tell, const_cast<Task*>(&part));
    oidnCommitFilter(filter.get());
    oidnExecuteFilter(filter.get());
    check();
    part.report(1);
    return out;
  }

 private:
  void check() const {
    const char* message = nullptr;
    const OIDNError error = oidnGetDeviceError(device_.get(), &message);
    task_.check();
    if (error != OIDN_ERROR_NONE)
      throw std::runtime_error(std::string("Open Image Denoise: ") + (message ? message : "unknown error"));
  }

  size_t width_, height_;
  const Task& task_;
  int quality_ = 0;
  std::unique_ptr<OIDNDeviceImpl, decltype(&oidnReleaseDevice)> device_{oidnNewDevice(OIDN_DEVICE_TYPE_CPU),
                                                                        &oidnReleaseDevice};
};

}  // namespace

std::string oidn_library_version() {
  return OIDN_VERSION_STRING;
}

Rgb denoise_by_library(const OidnPicture& picture, const Task& task) {
  const int width = picture.color[0]->width(), height = picture.color[0]->height();
  const Library library(width, height, picture.quality, task);
  std::vector<float> color = interleaved(picture.color), albedo, normal;
  if (picture.albedo) albedo = interleaved(*picture.albedo);
  if (picture.normal) normal = interleaved(*picture.normal);
  if (picture.prefilter) {
    albedo = library.clean({{"albedo", &albedo}}, false, false, 0, 0.33);
    normal = library.clean({{"normal", &normal}}, false, false, 0.33, 0.66);
  }
  const std::vector<float> clean = library.clean({{"color", &color}, {"albedo", &albedo}, {"normal", &normal}}, true,
                                                 picture.prefilter, picture.prefilter ? 0.66 : 0, 1);
  Rgb out;
  for (size_t c = 0; c < 3; ++c)
    out[c] = make_plane(width, height, quiet(task), [&](int x, int y) {
      return clean[3 * (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) + c];
    });
  return out;
}

}  // namespace brume

#else

namespace brume {

std::string oidn_library_version() {
  return "";
}

Rgb denoise_by_library(const OidnPicture&, const Task&) {
  throw std::logic_error("brume is built without the library of Open Image Denoise");
}

}  // namespace brume

#endif
