#include "image/sample_records.h"
#include "tests/fuzz/support.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  return brume::fuzz::read_as_file(data, size, ".records", [](const auto& path) {
    brume::RecordReader reader(path);
    for (int tile = 0; tile < reader.layout().tile_count(); ++tile) reader.read(tile);
  });
}
