// No include guard: after render/transport/cell_walk.h. What Detail (volume/detail.h) computes, in lanes.

/// Lattice cells and places in them, eased: 3 f^2 - 2 f^3.
struct NoiseCell {
  VI x, y, z;
  V3 f;
};
/// @param p       on the first octave's lattice   @param octave  of each lane   @param shift  the same in whole numbers
HWY_INLINE NoiseCell noise_cell(const LaneDetail& n, const V3& p, V octave, VI shift) {
  const DI di;
  const DU du;
  const V scale = hn::BitCast(D(), hn::ShiftLeft<23>(shift + 127));  // 2^octave
  const auto along = [&](V at, size_t axis, VI& cell) {
    const V c = at * scale + octave * static_cast<float>(Detail::kApart[axis]), whole = hn::Floor(c), f = c - whole;
    const VI before = hn::BitCast(di, hn::Shl(hn::BitCast(du, hn::Set(di, n.cell[axis])), hn::BitCast(du, shift)));
    cell = hn::ConvertTo(di, whole) + before;
    return f * f * (3.0f - 2.0f * f);
  };
  NoiseCell result;
  result.f.x = along(p.x, 0, result.x);
  result.f.y = along(p.y, 1, result.y);
  result.f.z = along(p.z, 2, result.z);
  return result;
}

/// Of lattice coordinates times Detail::kHashX and so on, the octave's and the phase's seed, all added.
HWY_INLINE V noise_sign(VU sum) {
  const DU du;
  VU h = hn::Xor(sum, hn::ShiftRight<16>(sum));
  h = h * hn::Set(du, 0x7feb352du);
  h = hn::Xor(h, hn::ShiftRight<15>(h));
  h = h * hn::Set(du, 0x846ca68bu);
  const VU one = hn::Set(du, 0x3f800000u), sign = hn::Set(du, 0x80000000u);
  return hn::BitCast(D(), hn::Or(hn::And(h, sign), one));
}
HWY_INLINE VU noise_hash(VI v, uint32_t by) {
  return hn::BitCast(DU(), v) * hn::Set(DU(), by);
}

/// On the first octave's lattice, where the flow was a time before.
HWY_INLINE V3 noise_place(const LaneDetail& n, const V3& p) {
  return transform(n.matrix, p) + set3(n.offset);
}
/// The components of a DetailFlow's words, where they lie in them.
HWY_INLINE V3 flow_words(V points) {
  const DI di;
  const VI words = hn::BitCast(di, points);
  const auto component = [&](int axis) {
    return hn::ConvertTo(D(), words & static_cast<int32_t>(DetailFlow::kMask << DetailFlow::kBits * axis));
  };
  return {component(0), component(1), component(2)};
}
/// The velocity at points; outside `mask` any.
HWY_INLINE V3 noise_velocity(const LaneDetail& n, const V3& p, M mask) {
  const DI di;
  const V3 points = set3(n.points), one{set(1), set(1), set(1)};
  const V3 at = min(max(p * n.inverse_spacing, zero3()), points - one), low = min(floor(at), points - one - one),
           f = at - low;
  const VI row = hn::ConvertTo(di, low.x * n.points[1] + low.y);
  const VI index = hn::IfThenElseZero(hn::RebindMask(di, mask), row * n.row + hn::ConvertTo(di, low.z));
  const auto mixed = [](const V3& a, const V3& b, V share) { return a + (b - a) * share; };
  const auto along_z = [&](int32_t offset) {
    const EntryPair pair = entry_pair(n.flow + offset, index);
    return mixed(flow_words(pair.first), flow_words(pair.second), f.z);
  };
  const V3 words =
      mixed(mixed(along_z(0), along_z(n.row), f.y), mixed(along_z(n.plane), along_z(n.plane + n.row), f.y), f.x);
  return (words - set3(n.rest)) * set3(n.step);
}

/// The noise at points of the first octave's lattice, all octaves.
HWY_INLINE V whole_noise(const LaneDetail& n, const V3& place, int32_t seed) {
  const DI di;
  const DU du;
  V sum = hn::Zero(D());
  for (int32_t o = 0; o < n.octaves; ++o) {
    const NoiseCell c = noise_cell(n, place, set(static_cast<float>(o)), hn::Set(di, o));
    const VU x = noise_hash(c.x, Detail::kHashX), y = noise_hash(c.y, Detail::kHashY),
             z = noise_hash(c.z, Detail::kHashZ),
             base =
                 x + y + z + hn::Set(du, static_cast<uint32_t>(seed) + static_cast<uint32_t>(o) * Detail::kHashOctave);
    const auto corner = [&](uint32_t offset) { return noise_sign(base + hn::Set(du, offset)); };
    const auto row = [&](uint32_t offset) { return lerp(corner(offset), corner(offset + Detail::kHashZ), c.f.z); };
    const auto face = [&](uint32_t offset) { return lerp(row(offset), row(offset + Detail::kHashY), c.f.y); };
    sum = sum + set(n.weight[o]) * lerp(face(0), face(Detail::kHashX), c.f.x);
  }
  return sum;
}

/// What the density is multiplied by at points, local coordinates; outside `mask` anything.
HWY_INLINE V detail_factor(const LaneDetail& n, const V3& p, M mask) {
  if (!n.flow) return 1.0f + n.amplitude * whole_noise(n, noise_place(n, p), n.phase[0].seed);
  const V3 along = noise_velocity(n, p, mask);
  V sum = hn::Zero(D());
  for (int32_t i = 0; i < n.phases; ++i)
    sum = sum + n.phase[i].weight * whole_noise(n, noise_place(n, p - along * n.phase[i].since), n.phase[i].seed);
  return 1.0f + n.amplitude * sum;
}

/// The factor by one sign, drawn by its weight: its expectation is detail_factor().
HWY_INLINE V drawn_detail(const LaneDetail& n, const V3& p, Generator& rng, M mask) {
  const DI di;
  const DU du;
  const VU low = hn::Set(du, 0xffffu), bits = rng.next(mask), more = rng.next(mask);
  const auto share = [&](VU of) { return (hn::ConvertTo(D(), hn::BitCast(di, of)) + 0.5f) * 0x1p-16f; };
  const V u = share(hn::And(bits, low));
  VI octave = hn::Zero(di);
  const VI one = hn::Set(di, 1);
  for (int32_t o = 0; o + 1 < n.octaves; ++o)
    octave = octave + hn::IfThenElseZero(hn::RebindMask(di, u >= n.weights_end[o]), one);
  VI seed = hn::Set(di, n.phase[0].seed);
  V3 there = p;
  if (n.flow) {
    const V which = share(hn::And(rng.next(mask), low));
    V since = set(n.phase[0].since);
    for (int32_t i = 0; i + 1 < n.phases; ++i) {
      const M later = which >= n.phase[i].weights_end;
      since = hn::IfThenElse(later, set(n.phase[i + 1].since), since);
      seed = hn::IfThenElse(hn::RebindMask(di, later), hn::Set(di, n.phase[i + 1].seed), seed);
    }
    there = p - noise_velocity(n, p, mask) * since;
  }
  const NoiseCell c = noise_cell(n, noise_place(n, there), hn::ConvertTo(D(), octave), octave);
  const auto drawn = [&](VI cell, V f, VU bits16) {
    return cell + hn::IfThenElseZero(hn::RebindMask(di, share(bits16) < f), one);
  };
  const VU sum = noise_hash(drawn(c.x, c.f.x, hn::ShiftRight<16>(bits)), Detail::kHashX) +
                 noise_hash(drawn(c.y, c.f.y, hn::And(more, low)), Detail::kHashY) +
                 noise_hash(drawn(c.z, c.f.z, hn::ShiftRight<16>(more)), Detail::kHashZ) +
                 noise_hash(octave, Detail::kHashOctave) + hn::BitCast(du, seed);
  return 1.0f + n.amplitude * noise_sign(sum);
}

/// The density at points, from what is stored there.
HWY_INLINE V with_detail(const LaneDetail& n, const V3& p, V stored, Generator& rng, M mask) {
  const M any = hn::And(mask, stored > 0.0f);
  return hn::AllFalse(D(), any) ? stored : hn::IfThenElse(any, stored * drawn_detail(n, p, rng, any), stored);
}
