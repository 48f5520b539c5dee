// No include guard: after render/transport/cell_walk.h. What the lanes of ray_march.cpp keep of their rays.

/// A number of each lane, in memory between steps.
struct Lane {
  HWY_ALIGN Lanes lanes = {};

  HWY_INLINE V load() const { return hn::Load(D(), lanes); }
  HWY_INLINE void store(V v) { hn::Store(v, D(), lanes); }
  HWY_INLINE void store(M mask, V v) { store(hn::IfThenElse(mask, v, load())); }
  HWY_INLINE void add(V v) { store(load() + v); }
  float& operator[](size_t lane) { return lanes[lane]; }
  float operator[](size_t lane) const { return lanes[lane]; }
};

/// A line of each lane in the coordinates of a grid or lattice.
struct Line {
  Lanes3 start, along;

  HWY_INLINE V3 at(V t) const { return start.load() + along.load() * t; }
  void set(size_t lane, const MarchedRay::Place& place) {
    start.set(lane, {place.start[0], place.start[1], place.start[2]});
    along.set(lane, {place.along[0], place.along[1], place.along[2]});
  }
};

/// The ray of each lane, for what is done one ray after the other.
struct RayLanes {
  MarchedRay* ray[hn::MaxLanes(D())] = {};

  /// Calls visit(lane, ray) for the lanes of a mask.
  template <class Visit>
  HWY_INLINE void for_each(M mask, Visit&& visit) const {
    for (uint32_t bits = bits_of(mask); bits; bits &= bits - 1) {
      const auto lane = static_cast<size_t>(std::countr_zero(bits));
      visit(lane, *ray[lane]);
    }
  }
  /// Calls visit(lane, ray, number) with the lane's number.
  template <class Visit>
  HWY_INLINE void for_each(M mask, V number, Visit&& visit) const {
    HWY_ALIGN Lanes numbers;
    hn::Store(number, D(), numbers);
    for_each(mask, [&](size_t lane, MarchedRay& of) { visit(lane, of, numbers[lane]); });
  }
};

/// The cell of a lattice that each lane's point lies in; points beyond the outermost nodes are moved to the border.
struct LatticeCell {
  VI node[3];  ///< the lowest of its eight nodes
  V f[3];      ///< from there to the next node, in [0, 1]

  /// @param n  nodes along each axis
  HWY_INLINE LatticeCell(const V3& p, const ivec3& n) {
    const V place[3] = {p.x, p.y, p.z};
    for (int a = 0; a < 3; ++a) {
      const V c = hn::Min(hn::Max(place[a], hn::Zero(D())), set(static_cast<float>(n[a] - 1)));
      const V whole = hn::Min(hn::Floor(c), set(static_cast<float>(n[a] - 2)));
      node[a] = hn::ConvertTo(DI(), whole);
      f[a] = c - whole;
    }
  }
};

/// Places on a lattice in nodes, from those in spacings.
HWY_INLINE V3 to_nodes(const Lattice& lattice, const V3& spacings) {
  if (!lattice.planes) return spacings;
  const auto along = [&](int axis, V place) {
    const LatticePlanes& planes = (*lattice.planes)[static_cast<size_t>(axis)];
    const V last = set(static_cast<float>(planes.first.size() - 1));
    const VI k = hn::ConvertTo(DI(), hn::Min(hn::Max(place, hn::Zero(D())), last));
    return hn::GatherIndex(D(), planes.first.data(), k) + hn::GatherIndex(D(), planes.per_spacing.data(), k) * place;
  };
  return {along(0, spacings.x), along(1, spacings.y), along(2, spacings.z)};
}

/// Values at the nodes of a lattice, linear between eight of them. Nothing is read for lanes outside `mask`.
HWY_INLINE V between_nodes(const Lattice& nodes, const float* values, const LatticeCell& cell, M mask) {
  const int row = nodes.row(), plane = row * nodes.n.y;
  const VI index =
      hn::IfThenElseZero(hn::RebindMask(DI(), mask), cell.node[0] * plane + cell.node[1] * row + cell.node[2]);
  const auto along_z = [&](int offset) { return between_entries(values + offset, index, cell.f[2]); };
  return lerp(lerp(along_z(0), along_z(row), cell.f[1]), lerp(along_z(plane), along_z(plane + row), cell.f[1]),
              cell.f[0]);
}

/// Two neighbouring 16-bit entries of a table. @param index  of the first
struct ShortPair {
  V first, second;
};
HWY_INLINE ShortPair short_pair(const uint16_t* table, VI index) {
  const DI di;
  const DU du;
#if HWY_TARGET <= HWY_AVX2
  const VI both = hn::GatherOffset(di, reinterpret_cast<const int32_t*>(table), index + index);
#else
  HWY_ALIGN int32_t at[RayQueue::kMost], word[RayQueue::kMost];
  hn::Store(index, di, at);
  for (size_t lane = 0; lane < hn::Lanes(di); ++lane) std::memcpy(word + lane, table + at[lane], sizeof(int32_t));
  const VI both = hn::Load(di, word);
#endif
  const VU bits = hn::BitCast(du, both);
  const auto number = [](VU v) { return hn::ConvertTo(D(), hn::BitCast(DI(), v)); };
  return {number(hn::And(bits, hn::Set(du, 0xffffu))), number(hn::ShiftRight<16>(bits))};
}

/// Optical depth towards a sun, from the square roots that its lattice stores, linear between eight nodes.
/// @param place  on that lattice
HWY_INLINE V depth_towards(const SunDepth& sun, const V3& place, M mask) {
  const ivec3& n = sun.nodes();
  const LatticeCell cell(place, n);
  const VI column = cell.node[1] * n.z + cell.node[2];
  const VI index = hn::IfThenElseZero(hn::RebindMask(DI(), mask), column * n.x + cell.node[0]);
  const auto along_x = [&](int32_t offset) {
    const ShortPair roots = short_pair(sun.roots() + offset, index);
    const V a = SunDepth::kRootStep * roots.first, b = SunDepth::kRootStep * roots.second;
    return lerp(a * a, b * b, cell.f[0]);
  };
  const int32_t next_z = n.x, next_y = n.x * n.z;
  return lerp(lerp(along_x(0), along_x(next_z), cell.f[2]), lerp(along_x(next_y), along_x(next_y + next_z), cell.f[2]),
              cell.f[1]);
}
