#pragma once
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <half.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "image/layers.h"

// What the files that know OpenEXR share.

namespace brume {

/// Opens a file of flat pixels, or of deep ones. @throws InputError: missing, a folder, not an EXR
Imf::MultiPartInputFile open_exr(const std::filesystem::path& path);

/// Refuses a part whose first lines do not hold as many bytes as its list of channels says: OpenEXR would take them for
/// other channels' values without a word. Looks into ZIP and unpacked scan lines. @throws InputError
void check_first_chunk(Imf::InputPart& part, const std::filesystem::path& path);

/// Says what a failure inside OpenEXR means, for a handler of exceptions: that memory was not enough, which OpenEXR's
/// threads pass on as text, or that the file is in this state: "truncated or damaged". Throws again what is no failure
/// of OpenEXR's. @throws OutOfMemory, InputError, Interrupted
[[noreturn]] void fail_exr(const std::filesystem::path& path, const std::string& state, const std::exception& error);

bool is_deep(const Imf::Header& header);
/// @param part  as part_label() has it   @throws InputError
[[noreturn]] void fail_deep(const std::filesystem::path& path, const std::string& part);

/// Refuses what a header asks for and this machine does not have. @throws OutOfMemory
void check_exr_memory(const std::filesystem::path& path, double bytes);

/// "part 'depth'" where a file has several, "its only part" otherwise.
std::string part_label(const Imf::MultiPartInputFile& file, int part);

/// A channel's name in a frame: in files of several parts it begins with the part's name.
std::string channel_name_in_frame(const Imf::MultiPartInputFile& file, int part, const std::string& channel);

/// The attribute that says how a picture of the surroundings is laid out, and what stands for it in Layers::header
/// where that is a cube.
inline constexpr const char *kEnvmap = "envmap", *kCube = "cube";

/// Adds an attribute, or replaces one of that name.
void insert_attribute(Imf::Header& header, const std::string& name, const Attribute& value);

/// What of a header is a property of the frame: what the library writes itself, or how pixels are packed, is not.
/// @param one_of_several  the part's own name and view are no properties of the whole frame
std::map<std::string, Attribute> exr_attributes(const Imf::Header& header, bool one_of_several = false);

/// A file that OpenEXR writes to and whose errors are not lost when it is closed.
class ExrOutputStream : public Imf::OStream {
 public:
  explicit ExrOutputStream(const std::filesystem::path& path);
  void write(const char bytes[], int count) override;
  uint64_t tellp() override { return static_cast<uint64_t>(file_.tellp()); }
  void seekp(uint64_t position) override;
  void close();

 private:
  void check() const;
  std::ofstream file_;
};

/// To nearest, its largest finite value for more; NaN and infinities stay.
half to_half(float value);

Imath::Box2i box_of(const PixelWindow& w);
PixelWindow window_of(const Imath::Box2i& b);

/// The layer's name with its dot where a part holds a picture as luminance and chroma: its channels are Y, RY and BY,
/// and a frame is given R, G and B in their place.
std::optional<std::string> chroma_layer(const Imf::ChannelList& channels);

/// Luminance of red, green and blue in the file's colour space.
std::array<float, 3> luminance_weights(const Imf::Header& header);

}  // namespace brume
