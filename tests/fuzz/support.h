#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

namespace brume::fuzz {

/// Writes an input to a file and has it read. A reader may succeed or refuse it with an InputError that says something;
/// anything else it throws ends the program, which libFuzzer reports.
/// @param extension  of the file's name, with the dot
/// @return 0, as libFuzzer asks for
int read_as_file(const uint8_t* data, size_t size, const std::string& extension,
                 const std::function<void(const std::filesystem::path&)>& read);

/// Whether a frame is small enough to be read here: a larger one is not wrong, it only needs the memory it says.
bool small(double width, double height, double channels);

}  // namespace brume::fuzz
