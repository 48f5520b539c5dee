#include "workflows/own_filters.h"

#include <fmt/format.h>

#include "evaluate/protocol/command_filter.h"

namespace brume {
namespace {

constexpr const char* kTenLines =
    R"(
## From an idea to its row in the table

In Python, ten lines. `mine.py` reads a frame and writes a picture:

```python
import sys, brume, numpy as np
frame = brume.read(sys.argv[1])  # brume.Layers
x = frame.image()                # the noisy colours: height x width x 3
square = [np.roll(x, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
brume.write(sys.argv[2], {"beauty": np.mean(square, axis=0)})
```

`mine.toml` compares it with what brume has:

```toml
scenes = ["data/scenes/cloud.toml"]
[[filters]]
filter = "bilateral"
[[filters]]
command = "python3 mine.py {frame} {output}"
```

`brume evaluate mine.toml -o results` puts it into every table and plot and on the page (`results/index.html`); with `--cache cache` a
changed script alone is run again. Without files, in a notebook, [`brume.evaluate`](python.md) takes a function:

```python
import brume, numpy as np

def mine(frame):  # brume.Layers in, height x width x 3 out
    x = frame.image()
    square = [np.roll(x, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    return np.mean(square, axis=0)

brume.evaluate("data/experiments/quick.toml", filters={"mine": mine}, output="results", cache="cache")
```

In C++, ten lines: `filters/window/mine.cpp`, and its name in `filters/CMakeLists.txt`. Command line, tuning, documentation and tests follow
([CONTRIBUTING](../CONTRIBUTING.md#add-a-filter)).

```cpp
#include "filters/api/registry.h"
#include "filters/inputs/planes.h"
namespace brume {
struct Mine { int radius = 2; };  // the defaults
void clean(const Mine& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  for (int c = 0; c < 3; ++c) *out[c] = box_mean(*frame.values[c], p.radius, task);
  task.report(1); }
const FilterEntry entry = declare<Mine>("mine", "Mean of a square.").source("an idea").merit(1, "to try it").paper("radius=1")
  .param("radius", &Mine::radius, {0, 9}, "px", "half width", {1, 2, 4}).apron([](const Mine& p) { return p.radius; }).run(clean);
const Registration registration(entry); }
```

`brume evaluate data/scenes/cloud.toml -f mine -f bilateral -o results` compares it; its search tunes `radius` over 1, 2, 4.

## Filters of others

`[[filters]] command = "..."` of an experiment ([experiment.md](experiment.md)) names any program. These places are filled in:

| place | becomes |
|---|---|
)";

constexpr const char* kRules =
    R"(
- **Words** are parted as by a shell, quotes included, but no shell runs: what it would expand or connect (`$`, `*`, `|`, `>`, ...) is refused
  outside of quotes. The program runs in the experiment's folder, where relative paths begin. A brace itself is written twice.
- **Frame**: the colour is what is cleaned, by the experiment's `component` as for every filter: the whole picture; `indirect` alone, to
  whose result the untouched `direct` is added; or each of both, in two runs. `layers = ["albedo", "normal"]` adds layers, `"guides"` among
  them all guides, `statistics = true` the variance of the mean and two half images of each: `mean_variance.R`, `half_a.R`,
  `albedo.half_b.G`. Alpha and coverage are there always. Values are as rendered: what brume's filters do to single extreme samples before
  they run is left to the program. Only pixels that are not finite, in frames of other renderers, are closed first.
- **Picture**: R, G, B, linear, of the frame's size, every pixel finite; an EXR of any compression, or a PFM.
- **Seconds** are the program's own, from its start to its end: loading itself, reading the frame and writing the picture are in it, since
  nobody but the program could take them out. Of two runs the second counts where one takes less than a second, as for every filter. What
  brume takes to write the frame (EXRs as ZIP, PFMs plain) and to read the picture is not in it; results.json tells it as
  `seconds.exchange`. Rendering is charged as for every filter: a render that records what it reads.
- **Memory** is what the program and all that it starts hold at most, looked at every 20 ms; its interpreter is in it, a daemon whose parent
  ends between two looks is not.
- **Limits**: `time_limit` (seconds) and `memory_limit` (GB, resident). A program that passes one is killed with everything it has started,
  daemons too: a variable in their environment tells them. The same limits hold for results out of the cache, by their seconds and memory.
- **Failures**: a limit passed, an exit status other than 0, no picture, one of another size or with a pixel that is not finite. The tables
  hold the reason and the last lines that the program wrote to stderr, and the run goes on.
- **Cache**: a result is kept under the words, the contents of the program and of every file that a word, or what follows its `=`, names,
  the contents of the files and folders of `depends`, the layers asked for, and the frame. `depends = ["weights.bin", "helpers"]` is for
  what the program reads unasked, such as modules that a script imports.
- **Settings**: nothing is searched, and ablation and sensitivity pass it over, since its parameters are its own; it stands under `default`,
  `searched` and `transfer` alike. For several settings, write several `[[filters]]` with a `label` each.
- **Sequences**: every frame by itself.

[data/experiments/of_others.toml](../data/experiments/of_others.toml) compares two scripts of NumPy: [joint_bilateral.py](../data/experiments/joint_bilateral.py)
reads a frame with its layers and statistics by `import brume`, [mean.py](../data/experiments/mean.py) a PFM without it.

A neural denoiser, Open Image Denoise's `oidnDenoise`, which is not part of brume and has to be in a folder of PATH
([data/experiments/oidn.toml](../data/experiments/oidn.toml)):

```toml
[[filters]]
command = "oidnDenoise --hdr {color.pfm} --alb {albedo.pfm} --nrm {normal.pfm} -o {output.pfm} --threads {threads}"
label = "Open Image Denoise"
```

`--weights weights.tza` takes weights trained for media, which the cache then knows by their contents.

From Python, `brume.evaluate(experiment, filters={"mine": f})` calls `f(frame)` in its own process, with what a program would be given, and
takes an array of height x width x 3 or `Layers` back. `f.layers`, `f.statistics` and `f.time_limit`, attributes of the function, are the
keys of the same names; a function cannot be stopped, so that its time is judged afterwards and its memory is not limited. An exception is
its failure; `KeyboardInterrupt` ends the run. With a cache, results are kept under the function's code: bytecode, constants, defaults, the
values it closes over, and the functions and values of its module that it names; of modules that it names, those that are not installed
count by their files, installed ones by name and version. Values that cannot be pickled are refused there until `f.cache_key = "version 1"`
says what to keep it under.
)";

}  // namespace

std::string own_filters_reference() {
  std::string text = kTenLines;
  for (const CommandPlace& place : command_places())
    text += fmt::format("| `{{{}}}` | {} |\n", place.name, place.meaning);
  return text + kRules;
}

}  // namespace brume
