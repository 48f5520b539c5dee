// No include guard: after render/guides/march_lanes.h. Segments of rays, and what they scatter of suns and lamps.

/// A number for each octave: with the whole extinction, a half, a quarter, an eighth of it.
inline constexpr size_t kOctaves = 4;

/// Part of a ray whose light is looked up at once: sums over its steps, which end where they are seen from.
/// docs/guides.md defines the weights; `scale` is the share of the extinction without the forward peak.
struct Segment {
  Lane begin, end;
  Lane w[kOctaves];                 ///< transmittance that the steps take, for each octave
  Lane scaled;                      ///< the same with `scale` times the extinction
  Lane unpeaked;                    ///< scaled / scale
  Lane thickness;                   ///< optical thickness
  Lane distance, peaks, albedo, g;  ///< times thickness; peaks: optical depth of forward peaks before a step
  Lane tint[3];                     ///< times albedo and thickness

  /// Calls visit with a function for each sum, which picks it out of a segment.
  template <class Visit>
  static HWY_INLINE void each_sum(Visit&& visit) {
    for (size_t k = 0; k < kOctaves; ++k) visit([k](auto& of) -> auto& { return of.w[k]; });
    for (Lane Segment::*sum : {&Segment::scaled, &Segment::unpeaked, &Segment::thickness, &Segment::distance,
                               &Segment::peaks, &Segment::albedo, &Segment::g})
      visit([sum](auto& of) -> auto& { return of.*sum; });
    for (int c = 0; c < 3; ++c) visit([c](auto& of) -> auto& { return of.tint[c]; });
  }
  /// Begins anew at its end, in the lanes of a mask.
  HWY_INLINE void clear(M mask) {
    begin.store(mask, end.load());
    each_sum([&](auto sum) { sum(*this).store(hn::IfThenZeroElse(mask, sum(*this).load())); });
  }
  void clear_lane(size_t lane) {
    begin[lane] = end[lane] = 0;
    each_sum([&](auto sum) { sum(*this)[lane] = 0; });
  }
  /// Adds the segment that follows, in the lanes of a mask.
  HWY_INLINE void join(const Segment& next, M mask) {
    const M fresh = hn::And(mask, thickness.load() <= 0.0f);
    begin.store(fresh, next.begin.load());
    end.store(mask, next.end.load());
    each_sum([&](auto sum) { sum(*this).add(hn::IfThenElseZero(mask, sum(next).load())); });
  }
  /// 1 / thickness: what sums are multiplied by to get means.
  HWY_INLINE V inverse_thickness() const { return 1.0f / hn::Max(thickness.load(), set(1e-37f)); }
};

/// LightTerms of a sun or lamp in each lane, and what segments have scattered of it so far, as GroupSums has it.
struct LightLanes {
  Line place;  // on a sun's lattice
  Lane irradiance, mean_depth, phase[kOctaves], peak[8];
  Lane single, forward, octave[kOctaves - 1], soft[4];
  Lane recent_single, recent_forward;  // of the segments since fields at nodes were added last

  void begin(size_t lane, const MarchedRay::Place& at, const LightTerms& terms) {
    place.set(lane, at);
    set_terms(lane, terms);
    single[lane] = forward[lane] = recent_single[lane] = recent_forward[lane] = 0;
    for (Lane& sum : octave) sum[lane] = 0;
    for (Lane& sum : soft) sum[lane] = 0;
  }
  void set_terms(size_t lane, const LightTerms& terms) {
    irradiance[lane] = terms.irradiance;
    mean_depth[lane] = terms.mean_depth;
    for (size_t i = 0; i < kOctaves; ++i) phase[i][lane] = terms.phase[i];
    for (size_t i = 0; i < 8; ++i) peak[i][lane] = terms.peak[i];
  }
  /// Sets phases and peaks from MarchScene::phase_tables. @param entry  a place in each table
  HWY_INLINE void look_up_phases(const float* tables, V entry, M mask) {
    const V first = hn::Min(hn::Floor(entry), hn::Set(D(), static_cast<float>(MarchScene::kPhaseEntries - 1)));
    const VI index = hn::ConvertTo(DI(), first);
    const auto next_table = [&] {
      return between_entries(std::exchange(tables, tables + MarchScene::kPhaseEntries + 1), index, entry - first);
    };
    for (Lane& one : phase) one.store(mask, next_table());
    for (Lane& one : peak) one.store(mask, next_table());
  }
  /// Adds what a segment scatters of the light that reaches it.
  /// @param visible  share of the light that surfaces leave
  /// @param tau      optical depth from its middle to the sun or to the middle of the lamp
  /// @param scale    share of the segment's extinction without the forward peak
  HWY_INLINE void add(const Segment& segment, bool sun, V visible, V tau, V scale, M mask) {
    const V inverse = segment.inverse_thickness();
    // V^(1/16), V^(1/8), ...; of a lamp, light of all of it arrives with its mean transmittance.
    const V v16 = exponential(tau * (-1.0f / 16)), v8 = v16 * v16, v4 = v8 * v8, v2 = v4 * v4;
    const V mean_tau = sun ? tau : mean_depth.load();
    const V arriving = sun ? v2 * v2 : exponential(-mean_tau);
    const V scattered = hn::IfThenElseZero(mask, irradiance.load() * (segment.albedo.load() * inverse) * visible);
    const V lit = segment.w[0].load() * scattered;

    // ForwardPeak::repeated times what arrives: exponentials that would overflow are multiplied first.
    const V depth =
        hn::Min((1.0f - scale) * tau + segment.peaks.load() * inverse, set(static_cast<float>(ForwardPeak::kDeepest)));
    V terms = peak[6].load();
    for (size_t i = 6; i-- > 0;) terms = peak[i].load() + depth * terms;
    const V repeated = arriving * (depth * terms) + peak[7].load() * (exponential(depth - mean_tau) - arriving);
    const V once = lit * (phase[0].load() * arriving), again = lit * hn::Max(repeated, hn::Zero(D()));
    single.add(once);
    forward.add(again);
    recent_single.add(once);
    recent_forward.add(again);

    octave[0].add(segment.w[1].load() * scattered * (phase[1].load() * v2));
    octave[1].add(segment.w[2].load() * scattered * (phase[2].load() * v4));
    octave[2].add(segment.w[3].load() * scattered * (phase[3].load() * v8));
    const V even = lit * (0.25f * std::numbers::inv_pi_v<float>);
    const V softened[4] = {v2, v4, v8, v16};
    for (size_t i = 0; i < 4; ++i) soft[i].add(even * softened[i]);
  }
  void add_to(GroupSums& group, size_t lane) const {
    group.single += single[lane];
    group.forward += forward[lane];
    for (size_t i = 0; i < 3; ++i) group.octave[i] += octave[i][lane];
    for (size_t i = 0; i < 4; ++i) group.soft[i] += soft[i][lane];
  }
};
