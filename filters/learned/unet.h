#pragma once
#include <filesystem>
#include <memory>
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// One of Open Image Denoise's published networks: convolutions of 3 x 3 at full size and a half to a sixteenth of it,
/// down and up again, each size up reading what the way down left there (Ronneberger, Fischer and Brox 2015). Which
/// sizes its layers have is in the file: base and small differ in that alone, large has another layer at each level.
class Unet {
 public:
  /// @param inputs  channels that it reads
  /// @throws InputError for a file that is damaged, or of a network of another kind
  Unet(const std::filesystem::path& weights, int inputs);
  ~Unet();

  /// Evaluates the network, in tiles where the whole would take more than `memory` bytes. Tiles overlap by what a pixel
  /// depends on, so that they change nothing; the bits do not depend on the number of threads.
  /// @param in  planes of one size, one for each input
  Rgb evaluate(const std::vector<const Plane*>& in, const Task& task, double memory = kMemory) const;

  static constexpr double kMemory = 1e9;

 private:
  struct Network;
  std::unique_ptr<const Network> network_;
};

}  // namespace brume
