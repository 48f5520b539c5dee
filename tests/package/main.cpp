// What somebody else's program may do with an installed brume: render, clean, compare, write.

#include <brume/base.h>
#include <brume/evaluate.h>
#include <brume/filters.h>
#include <brume/image.h>
#include <brume/render.h>
#include <brume/volume.h>
#include <brume/workflows.h>

#include <cstdio>

int main(int count, char** words) {
  if (count != 3) return 2;
  const std::string small[] = {"film.width=24", "film.height=16"};
  const brume::LoadedScene loaded = brume::load_scene(words[1], small);
  const brume::PreparedScene scene(loaded.scene, {});
  const brume::Layers noisy = scene.render(4, 0).layers, reference = scene.render(64, 1).layers;
  brume::ApplyOptions options;
  options.component = brume::Component::kAll;
  const brume::Recommendation best = brume::recommend_filter(noisy, options);
  const brume::Layers clean = brume::apply_filter(best.filter, noisy, options, {});
  brume::write_exr(words[2], clean);
  const auto error = [&](const brume::Layers& x) {
    return brume::compare(x.rgb(brume::layer::beauty), reference.rgb(brume::layer::beauty), {}).lab_rms;
  };
  std::printf("%zu filters, %s, %s: Lab RMS %.3f before, %.3f after\n", brume::all_filters().size(),
              brume::version_number().c_str(), best.filter.entry().name.c_str(), error(noisy), error(clean));
  return error(clean) < error(noisy) ? 0 : 1;
}
