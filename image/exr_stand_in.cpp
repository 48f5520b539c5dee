#include "image/exr_stand_in.h"

#include "base/file_kind.h"
#include "image/exr_io.h"
#include "image/hdr_io.h"
#include "image/pfm_io.h"

namespace brume {

ExrStandIn::ExrStandIn(const std::filesystem::path& file) : exr_(file) {
  const FileKind kind = known_file(file).kind;
  if (kind != FileKind::kRadiance && kind != FileKind::kFloatMap) return;
  const Layers picture = kind == FileKind::kRadiance ? read_hdr(file) : read_pfm(file);
  folder_ = std::make_unique<ScratchFolder>();
  exr_ = *folder_ / "picture.exr";
  write_exr(exr_, picture);
}

}  // namespace brume
