// A program that reads the words and files of Open Image Denoise's oidnDenoise and answers as it does, for tests:
// colour, albedo and normal as PFM, a clean PFM, progress on stdout, errors on stderr. In place of a network it has a
// joint bilateral filter. It knows nothing of brume, so that the format of the files is not taken from the code under
// test.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

struct Image {
  int width = 0, height = 0;
  std::vector<float> values;  // three for each pixel, the top row first

  const float* at(int x, int y) const { return values.data() + 3 * (static_cast<size_t>(y) * width + x); }
};

Image load(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot open image file: '" + path + "'");
  std::string kind;
  Image image;
  float scale = 0;
  file >> kind >> image.width >> image.height >> scale;
  file.get();
  if (kind != "PF" || !file) throw std::runtime_error("invalid PFM image");
  if (scale >= 0) throw std::runtime_error("big-endian PFM images are not supported");
  image.values.resize(3 * static_cast<size_t>(image.width) * image.height);
  for (int y = image.height - 1; y >= 0; --y)
    file.read(reinterpret_cast<char*>(image.values.data() + 3 * static_cast<size_t>(y) * image.width),
              static_cast<std::streamsize>(3 * sizeof(float)) * image.width);
  if (!file) throw std::runtime_error("invalid PFM image");
  return image;
}

void save(const std::string& path, const Image& image) {
  std::ofstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot open image file: '" + path + "'");
  file << "PF" << std::endl << image.width << " " << image.height << std::endl << "-1.0" << std::endl;
  for (int y = image.height - 1; y >= 0; --y)
    file.write(reinterpret_cast<const char*>(image.at(0, y)),
               static_cast<std::streamsize>(3 * sizeof(float)) * image.width);
}

float squared_distance(const float* a, const float* b) {
  float sum = 0;
  for (int c = 0; c < 3; ++c) sum += (a[c] - b[c]) * (a[c] - b[c]);
  return sum;
}

Image denoise(const Image& colour, const std::vector<Image>& features) {
  constexpr int kRadius = 3;
  Image clean = colour;
  for (int y = 0; y < colour.height; ++y)
    for (int x = 0; x < colour.width; ++x) {
      float sum[3] = {}, total = 0;
      for (int v = std::max(0, y - kRadius); v <= std::min(colour.height - 1, y + kRadius); ++v)
        for (int u = std::max(0, x - kRadius); u <= std::min(colour.width - 1, x + kRadius); ++u) {
          float distance = static_cast<float>((u - x) * (u - x) + (v - y) * (v - y)) / 4.0f;
          for (const Image& f : features) distance += squared_distance(f.at(x, y), f.at(u, v)) / 0.1f;
          const float weight = std::exp(-0.5f * distance);
          for (int c = 0; c < 3; ++c) sum[c] += weight * colour.at(u, v)[c];
          total += weight;
        }
      for (int c = 0; c < 3; ++c) clean.values[3 * (static_cast<size_t>(y) * colour.width + x) + c] = sum[c] / total;
    }
  return clean;
}

/// Options with one value, by all their names.
const std::map<std::string, std::string> kOptions = {
    {"hdr", "colour"},       {"ldr", "colour"},      {"alb", "albedo"},    {"albedo", "albedo"},
    {"nrm", "normal"},       {"normal", "normal"},   {"o", "output"},      {"out", "output"},
    {"output", "output"},    {"threads", "threads"}, {"w", "weights"},     {"weights", "weights"},
    {"t", "type"},           {"type", "type"},       {"q", "quality"},     {"quality", "quality"},
    {"maxmem", "memory"},    {"d", "device"},        {"device", "device"}, {"v", "verbose"},
    {"verbose", "verbose"},  {"f", "filter"},        {"filter", "filter"}, {"is", "scale"},
    {"input_scale", "scale"}};

void run(const std::vector<std::string>& words) {
  std::map<std::string, std::string> given;
  for (size_t i = 0; i < words.size(); ++i) {
    if (!words[i].starts_with("-")) throw std::runtime_error("invalid argument '" + words[i] + "'");
    const std::string name = words[i].substr(words[i].starts_with("--") ? 2 : 1);
    if (name == "srgb" || name == "clean_aux" || name == "inplace") continue;
    const auto option = kOptions.find(name);
    if (option == kOptions.end()) throw std::runtime_error("invalid argument '" + name + "'");
    if (++i == words.size()) throw std::runtime_error("argument value expected for '" + name + "'");
    given[option->second] = words[i];
  }
  if (!given.contains("colour")) throw std::runtime_error("no input image specified");
  std::cout << "Loading input" << std::endl;
  const Image colour = load(given["colour"]);
  std::cout << "Resolution: " << colour.width << "x" << colour.height << std::endl;
  std::vector<Image> features;
  for (const char* name : {"albedo", "normal"})
    if (given.contains(name)) {
      features.push_back(load(given[name]));
      if (features.back().width != colour.width || features.back().height != colour.height)
        throw std::runtime_error("image size mismatch");
    }
  if (given.contains("weights") && !std::ifstream(given["weights"]))
    throw std::runtime_error("cannot open file: '" + given["weights"] + "'");
  const Image clean = denoise(colour, features);
  std::cout << "\rDenoising 50%\rDenoising 100%" << std::endl << "Saving output" << std::endl;
  if (given.contains("output")) save(given["output"], clean);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << "Error: " << error.what() << std::endl;
    return 1;
  }
  return 0;
}
