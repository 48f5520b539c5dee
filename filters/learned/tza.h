#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace brume {

/// An array of a network: its sizes, the outermost first, and a letter for each of them ("oihw": output, input, row,
/// column; "x").
struct Tensor {
  std::vector<int> sizes;
  std::string layout;
  std::vector<float> values;
};

/// The arrays of a network by name, from a tensor archive (TZA 2.x) of Open Image Denoise. Little endian: 0x41D7 (2
/// bytes), version (2), where the table is (8); the table: count (4), and of each array the length of its name (2),
/// name, number of sizes (1), sizes (4 each), letters (1 each), 'f' or 'h' for floats or halves, where its values are
/// (8).
/// @throws InputError with file and array: cut, not such a file, values beyond its end or not finite
std::map<std::string, Tensor> read_tza(const std::filesystem::path& path);

}  // namespace brume
