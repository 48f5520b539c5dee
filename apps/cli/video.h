#pragma once
#include <filesystem>
#include <vector>

namespace brume::app {

/// A film of pictures of one size, by ffmpeg; its kind follows the name's ending (mp4, mov, webm).
/// @return  whether it was written; what is in the way is told
bool write_video(const std::filesystem::path& path, const std::vector<std::filesystem::path>& pictures,
                 double frame_rate);

}  // namespace brume::app
