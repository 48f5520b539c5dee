// No include guard: after render/guides/march_lanes.h. All media together at a point of each lane's ray.

struct MediaPoint {
  V extinction;  // per step
  V albedo, g;   // of all that scatters there
  V density;     // the largest, each as a share of its medium's maximum
  V3 gradient;   // of the extinction, world axes
  V3 tint;       // of light scattered once
  V seen;        // share of the extinction that is of no holdout
};

/// The brick of a grid that each lane's point lies in.
struct BrickPoint {
  M inside;  // lanes whose points lie in a brick; the others are outside the grid or in an empty cell
  VI brick;  // offset of its values
  V3 q;      // the point, from the brick's lowest corner [voxels]
};

HWY_INLINE BrickPoint brick_at(const LaneCells& c, const V3& p, M active) {
  const DI di;
  M inside = active;
  const auto cell = [&](V v, float n) {
    inside = hn::And(inside, hn::And(v > 0.0f, v < n * c.cell));
    return hn::Floor(v * c.inverse_cell);
  };
  const V3 at{cell(p.x, c.nx), cell(p.y, c.ny), cell(p.z, c.nz)};
  if (hn::AllFalse(D(), inside)) return {inside, hn::Zero(di), zero3()};
  const V row = at.x * c.ny + at.y;
  const VI index = hn::ConvertTo(di, row) * c.nz_int + hn::ConvertTo(di, at.z);
  const VI brick = hn::GatherIndex(di, c.brick, hn::IfThenElseZero(hn::RebindMask(di, inside), index));
  return {hn::AndNot(hn::RebindMask(D(), brick < 0), inside), brick, p - at * set(c.cell)};
}

class MediaLanes {
 public:
  explicit MediaLanes(const MarchScene& scene) : scene_(scene) {}

  void begin(size_t lane, const MarchedRay& ray) {
    for (size_t i = 0; i < scene_.grids.size(); ++i) grid_[i].set(lane, ray.grid[i]);
    for (size_t i = 0; i < scene_.shapes.size(); ++i) {
      shape_begin_[i][lane] = ray.shape[i].x;
      shape_end_[i][lane] = ray.shape[i].y;
    }
  }

  HWY_INLINE MediaPoint at(const RayLanes& rays, M active, V t) const {
    if (scene_.grids.empty() && scene_.shapes.empty()) return one_by_one(rays, active, t);
    const V zero = hn::Zero(D());
    MediaPoint sum{zero, zero, zero, zero, zero3(), zero3(), scene_.holdouts ? zero : set(1.0f)};
    for (size_t i = 0; i < scene_.grids.size(); ++i) add_grid(scene_.grids[i], grid_[i].at(t), active, sum);
    for (size_t i = 0; i < scene_.shapes.size(); ++i) add_shape(i, t, active, sum);
    if (scene_.grids.size() + scene_.shapes.size() > 1)
      make_means(sum);
    else if (scene_.grids.empty())
      take_constants(scene_.shapes[0], sum);
    else
      take_constants(scene_.grids[0], sum);
    return sum;
  }

 private:
  /// Adds a medium at a point: albedo and seen times extinction, g and tint times scattering.
  HWY_INLINE void add_grid(const MarchedGrid& grid, const V3& p, M active, MediaPoint& sum) const {
    const LaneCells& c = grid.cells;
    const BrickPoint in_brick = brick_at(c, p, active);
    if (hn::AllFalse(D(), in_brick.inside)) return;

    const InVoxel at = voxel_at(c, in_brick.brick, in_brick.q);
    const VI first = hn::IfThenElseZero(hn::RebindMask(DI(), in_brick.inside), at.index);
    const V fx = at.f.x, fy = at.f.y, fz = at.f.z;
    const int y = c.stored, x = y * y;  // from a value to its neighbour on that axis
    const EntryPair e00 = entry_pair(c.values, first), e01 = entry_pair(c.values + y, first),
                    e10 = entry_pair(c.values + x, first), e11 = entry_pair(c.values + x + y, first);
    const auto along_z = [&](const EntryPair& e) { return lerp(e.first, e.second, fz); };
    const auto change = [&](const EntryPair& e) { return e.second - e.first; };
    const V z00 = along_z(e00), z01 = along_z(e01), z10 = along_z(e10), z11 = along_z(e11);
    const V near = lerp(z00, z01, fy), far = lerp(z10, z11, fy);
    const V found = lerp(near, far, fx);
    const M any = hn::And(in_brick.inside, found > 0.0f);
    const auto only = [&](V v) { return hn::IfThenElseZero(any, v); };
    const V density = only(grid.detail.octaves > 0 ? found * detail_factor(grid.detail, p, any) : found);
    const V3 slope{only(far - near), only(lerp(z01 - z00, z11 - z10, fx)),
                   only(lerp(lerp(change(e00), change(e01), fy), lerp(change(e10), change(e11), fy), fx))};
    sum.gradient += transform(grid.gradient, slope);
    add(grid, density * grid.extinction, density * grid.inverse_maximum, sum);
  }

  HWY_INLINE void add_shape(size_t number, V t, M active, MediaPoint& sum) const {
    const MarchedShape& shape = scene_.shapes[number];
    const M inside = hn::And(active, hn::And(t >= shape_begin_[number].load(), t <= shape_end_[number].load()));
    const auto only = [&](float v) { return hn::IfThenElseZero(inside, set(v)); };
    add(shape, only(shape.extinction), only(1.0f), sum);
  }

  HWY_INLINE void add(const auto& medium, V extinction, V density, MediaPoint& sum) const {
    const V scattered = extinction * (medium.seen * medium.albedo);
    sum.extinction = sum.extinction + extinction;
    sum.albedo = sum.albedo + scattered;
    sum.g = sum.g + scattered * medium.g;
    sum.density = hn::Max(sum.density, density);
    sum.tint += scattered * set3(medium.tint);
    if (scene_.holdouts) sum.seen = sum.seen + extinction * medium.seen;
  }

  /// Divides the sums of several media by what add() weighed them with.
  HWY_INLINE void make_means(MediaPoint& sum) const {
    const V zero = hn::Zero(D());
    const auto share = [&](V part, V whole) {
      return hn::IfThenElseZero(whole > zero, part / hn::Max(whole, set(1e-37f)));
    };
    const V scattered = sum.albedo;
    sum.albedo = share(scattered, scene_.holdouts ? sum.seen : sum.extinction);
    sum.g = share(sum.g, scattered);
    sum.tint = {share(sum.tint.x, scattered), share(sum.tint.y, scattered), share(sum.tint.z, scattered)};
    if (scene_.holdouts) sum.seen = share(sum.seen, sum.extinction);
  }

  /// Where there is one medium, nothing but its density varies.
  HWY_INLINE void take_constants(const auto& medium, MediaPoint& sum) const {
    sum.seen = set(medium.seen);
    sum.albedo = set(medium.albedo);
    sum.g = set(medium.g);
    sum.tint = set3(medium.tint);
  }

  /// For media that have no vector form.
  MediaPoint one_by_one(const RayLanes& rays, M active, V t) const {
    Lane extinction, albedo, g, density, seen;
    Lanes3 gradient, tint;
    rays.for_each(active, t, [&](size_t lane, MarchedRay& ray, float at) {
      const MarchScene::Point p = scene_.at(ray, at);
      extinction[lane] = p.extinction;
      albedo[lane] = p.albedo;
      g[lane] = p.g;
      density[lane] = p.density;
      gradient.set(lane, p.gradient);
      tint.set(lane, p.tint);
      seen[lane] = p.seen;
    });
    return {extinction.load(), albedo.load(), g.load(), density.load(), gradient.load(), tint.load(), seen.load()};
  }

  const MarchScene& scene_;
  Line grid_[kMostMarchedGrids];
  Lane shape_begin_[kMostMarchedShapes], shape_end_[kMostMarchedShapes];
};
