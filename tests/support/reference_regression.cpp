#include "tests/support/reference_regression.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <string>

namespace brume::test {
namespace {

using Eigen::MatrixXd;
using Guide = std::map<char, Values>;  // by channel

enum Fit { kPredicted, kShape, kAll, kMedium, kFew, kFits };

class Reference {
 public:
  Reference(const Layers& frame, const LayerName& signal)
      : frame_(frame), n_(frame.width() * frame.height()), direct_(signal == layer::direct), x_(n_), y_(n_) {
    for (int i = 0; i < n_; ++i) x_[i] = i % frame.width(), y_[i] = i / frame.width();
    for (size_t c = 0; c < 3; ++c) {
      data_[0][c] = values(signal.channel_of(statistic::half_a, c));
      data_[1][c] = values(signal.channel_of(statistic::half_b, c));
    }
  }

  ReferenceRegression run() {
    sort_guides();
    draw_outliers_in();
    cascade();
    return {mask_, data_, candidates_, stacked()};
  }

 private:
  Values values(const std::string& channel) const {
    Values v(n_);
    for (int i = 0; i < n_; ++i) v[i] = frame_.at(channel)(static_cast<int>(x_[i]), static_cast<int>(y_[i]));
    return v;
  }
  static Values mean(const Halves& h, size_t c) { return (h[0][c] + h[1][c]) / 2; }
  static Values brightness_of_mean(const Halves& h) { return brightness({mean(h, 0), mean(h, 1), mean(h, 2)}); }
  static Values brightness(const Colours& c) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; }
  /// 1 in the square around a pixel.
  Values near(int p, double radius) const {
    return ((x_ - x_[p]).abs().max((y_ - y_[p]).abs()) <= radius).cast<double>();
  }
  /// G(q - p) of every two pixels, cut off at 2.5 deviations.
  MatrixXd window(double s) const {
    MatrixXd g(n_, n_);
    for (int p = 0; p < n_; ++p)
      g.row(p) = near(p, std::ceil(2.5 * s)) * (-((x_ - x_[p]).square() + (y_ - y_[p]).square()) / (2 * s * s)).exp();
    return g;
  }

  // ---- The model: which guide explains what.

  void sort_guides() {
    std::map<std::string, Guide> guides;
    for (const std::string& name : frame_.names())
      if (name.starts_with("guide.")) guides[name.substr(6, name.size() - 8)][name.back()] = values(name);
    const auto first = [](const std::string& name) { return name.substr(0, name.find('.')); };
    const std::string expected = direct_ ? "predicted_direct" : "predicted_indirect";
    const auto add = [&](const Guide& guide, const std::vector<Fit>& fits) {
      for (const Fit fit : fits)
        if (guide.size() == 3 && guide.contains('R'))
          columns_[fit].push_back({guide.at('R'), guide.at('G'), guide.at('B')});
        else
          for (const auto& [letter, v] : guide) columns_[fit].push_back({v, v, v});
    };
    const std::vector<Fit> every = {kPredicted, kShape, kAll, kMedium, kFew}, none;
    add(guides.at("opacity"), every);
    const bool surfaces =
        std::any_of(guides.begin(), guides.end(), [&](const auto& g) { return first(g.first) == "surface"; });
    if (surfaces || (direct_ && !guides.contains("background"))) add({{'Y', Values::Ones(n_)}}, every);
    if (guides.contains(expected)) {
      add(guides.at(expected), {kPredicted, kShape});
      const Colours& prediction = columns_[kPredicted].back();
      candidates_.push_back({prediction, prediction});
    }
    if (direct_ && guides.contains("background")) add(guides.at("background"), {kAll, kMedium, kFew});
    base_ = columns_[kAll].size();
    for (const auto& [name, guide] : guides)
      if (const std::string word = first(name); word == "single")
        add(guide, {kAll, kMedium});
      else if (word == "multiple")
        add(guide, direct_ ? none : std::vector{kAll});
      else if (word.starts_with("predicted") || word == "background")
        add(guide, direct_ || word == expected ? none : std::vector{kShape});
      else if (word != "opacity" && word != "surface_material")  // geometry, surfaces, emission
        add(guide, {kShape, kAll, kMedium});
    // Cleaned is what guides know, and where halves differ; a first idea of the brightness is what is expected.
    Values differ = Values::Zero(n_);
    for (size_t c = 0; c < 3; ++c)
      differ += ((data_[0][c] - data_[1][c]).abs() > 2e-3 * (data_[0][c] + data_[1][c]).abs()).cast<double>();
    level_ = Values::Zero(n_);
    mask_ = (guides.at("opacity").begin()->second > 1e-3).cast<double>();
    for (int p = 0; p < n_; ++p) mask_[p] = std::max(mask_[p], std::min(1.0, (near(p, 1) * differ).sum()));
    for (const auto& [name, guide] : guides) {
      if (name == expected) level_ = brightness({guide.at('R'), guide.at('G'), guide.at('B')});
      for (const auto& [letter, v] : guide)
        if (first(name) == "surface" || name == "normal") mask_ = mask_.max((v != 0).cast<double>());
    }
  }

  // ---- Weights, columns and fits.

  Values weights() const { return weights(direct_ ? 0.0 : 1.2); }
  Values weights(double power) const {
    const Values light = level_.max(0.0), relative = light * mask_.sum() / (light * mask_).sum();
    return mask_ * (relative + 0.1).pow(-power);
  }

  /// Frees columns of their projection on the first and scales them to one size.
  void standardise(Fit fit) {
    const Values w = weights();
    const std::vector<Colours> given = columns_[fit];
    for (size_t k = 0; k < given.size(); ++k)
      for (size_t c = 0; c < 3; ++c) {
        const Values &v = given[k][c], &first = given[0][c];
        const double offset = k == 0 ? 0 : (w * first * v).sum() / (w * first * first).sum();
        const double left = (w * v * v).sum() - offset * (w * first * v).sum();
        const bool nothing = !(left > 3e-6 * (w * v * v).sum());
        columns_[fit][k][c] = nothing ? Values(Values::Zero(n_)) : (v - offset * first) * std::sqrt(w.sum() / left);
      }
  }

  /// Solves A b = t, the part above A's diagonal being given: a ridge pulls all but the first `free` coefficients to 0,
  /// and a column that those before explain to rounding drops out.
  static MatrixXd solve(MatrixXd a, MatrixXd t, double ridge, int free) {
    const int m = static_cast<int>(a.rows());
    const Eigen::VectorXd variance = a.diagonal();
    for (int k = 0; k < m; ++k) {
      if (k == free) a.diagonal().tail(m - k) *= 1 + ridge;
      if (!(a(k, k) > 3e-6 * variance[k])) a.row(k).setZero(), t.row(k).setZero(), a(k, k) = 1;
      for (int j = k + 1; j < m; ++j) {
        t.row(j) -= a(k, j) / a(k, k) * t.row(k);
        a.row(j).tail(m - j) -= a(k, j) / a(k, k) * a.row(k).tail(m - j);
      }
    }
    return a.triangularView<Eigen::Upper>().solve(t);
  }

  /// Fits both halves, in windows of the deviation s; 0: the frame.
  Halves fitted(const std::vector<Colours>& columns, const Halves& to, const Values& w, double s, double ridge,
                double ridge_per_pixel, size_t free) const {
    Halves out = to;
    const int m = static_cast<int>(columns.size());
    // Nodes by pixels, and pixels by nodes.
    const MatrixXd g = s > 0 ? window(s) : MatrixXd::Ones(1, n_), smooth = s > 0 ? window(0.6 * s) : g.transpose();
    const Values total = (g * w.matrix()).array(), pixels = total.square() / (g * w.square().matrix()).array();
    for (size_t c = 0; c < 3; ++c) {
      MatrixXd products(n_, m * (m + 1) / 2 + 2 * m), coefficients(total.size(), 2 * m);
      const auto of = [&](int k) -> const Values& {
        return k < m ? columns[static_cast<size_t>(k)][c] : to[static_cast<size_t>(k - m)][c];
      };
      for (int k = 0, at = 0; k < m; ++k)
        for (int l = k; l < m + 2; ++l) products.col(at++) = w * of(k) * of(l);
      const MatrixXd sums = g * products;
      for (int p = 0; p < total.size(); ++p) {
        MatrixXd a = MatrixXd::Zero(m, m), t(m, 2), b = MatrixXd::Zero(m, 2);
        for (int k = 0, at = 0; k < m; ++k)
          for (int l = k; l < m + 2; ++l) (l < m ? a(k, l) : t(k, l - m)) = sums(p, at++) / total[p];
        if (total[p] > 0) b = solve(a, t, ridge + ridge_per_pixel / pixels[p], static_cast<int>(free));
        coefficients.row(p) = total[p] * Eigen::Map<const Eigen::RowVectorXd>(b.data(), 2 * m);
      }
      const MatrixXd blurred = smooth * coefficients;
      const Values all = (smooth * total.matrix()).array();
      for (size_t half = 0; half < 2; ++half) {
        out[half][c].setZero();
        for (int k = 0; k < m; ++k)
          out[half][c] += (w > 0).select(blurred.col(static_cast<int>(half) * m + k).array() / all * of(k), 0.0);
      }
    }
    return out;
  }

  // ---- Cascade of windows.

  void refine(Fit fit, double s, double ridge, double ridge_per_pixel, size_t free = 0) {
    const Halves found = fitted(columns_[fit], left_, weights(), s, ridge, ridge_per_pixel, free);
    for (size_t half = 0; half < 2; ++half)
      for (size_t c = 0; c < 3; ++c) left_[half][c] -= found[half][c], sum_[half][c] += found[half][c];
    candidates_.push_back(sum_);
  }

  void cascade() {
    left_ = data_;
    sum_.fill({Values::Zero(n_), Values::Zero(n_), Values::Zero(n_)});
    refine(kPredicted, 0, 1e-4, 0, columns_[kPredicted].size());
    const Halves left = left_, sum = sum_;
    for (const double s : {16, 4}) refine(kShape, s, 2e-3, 1);
    left_ = left, sum_ = sum;
    for (const double ridge : {1e4, 1.0}) refine(kAll, 0, 1e-4, ridge);
    // Weights now follow what was found, averaged over 3 x 3 pixels, which joins the columns of narrow windows.
    const Values found = brightness_of_mean(sum_);
    for (int p = 0; p < n_; ++p) level_[p] = (near(p, 1) * found).sum() / near(p, 1).sum();
    for (const Fit fit : {kMedium, kFew}) {
      columns_[fit].push_back({level_, level_, level_});
      standardise(fit);
    }
    refine(kAll, 16, 2e-3, 1);
    refine(kMedium, 8, 2e-3, 1);
    refine(kFew, 4, 2e-3, 1);
    candidates_.push_back(data_);
  }

  // ---- Stacking.

  /// pi >= 0, sum 1, of the least pi^T D pi, by projected gradients.
  static Eigen::VectorXd simplex_minimum(const MatrixXd& quadratic) {
    const MatrixXd d = quadratic.array() - quadratic.minCoeff();
    const auto n = d.rows();
    Eigen::VectorXd pi = Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n));
    for (int step = 0; step < 2000 && d.trace() > 0; ++step) {
      pi -= d * pi / d.trace();
      double low = pi.minCoeff() - 1, high = pi.maxCoeff();  // the level that leaves a sum of 1
      for (int i = 0; i < 50; ++i) {
        const double level = (low + high) / 2;
        ((pi.array() - level).max(0.0).sum() > 1 ? low : high) = level;
      }
      pi = (pi.array() - low).max(0.0);
    }
    return pi / pi.sum();
  }

  Halves stacked() const {
    const size_t n = candidates_.size();
    const Values counts = weights(1.2);
    MatrixXd errors(n_, n * n), squares(n_, n);
    for (size_t i = 0; i < n; ++i) {
      for (size_t j = 0; j < n; ++j) {
        Values sum = Values::Zero(n_);
        for (size_t c = 0; c < 3; ++c) {
          const Values &ya = data_[0][c], &yb = data_[1][c], &ai = candidates_[i][0][c], &aj = candidates_[j][0][c],
                       &bi = candidates_[i][1][c], &bj = candidates_[j][1][c];
          sum += ((yb - ai) * (yb - aj) + (ya - bi) * (ya - bj)) / 2 - (ai - bi) * (aj - bj) / 4;
        }
        errors.col(static_cast<int>(i * n + j)) = counts * sum;
      }
      squares.col(static_cast<int>(i)) = (errors.col(static_cast<int>(i * n + i)) - errors.col(0)).array().square();
    }
    const auto matrix = [&](const Eigen::VectorXd& v) { return MatrixXd(Eigen::Map<const MatrixXd>(v.data(), n, n)); };
    const MatrixXd sums = window(28) * errors, frame = matrix(errors.colwise().sum()), local = window(28) * squares;
    const Eigen::RowVectorXd all = squares.colwise().sum();
    const double share = 5000 / mask_.sum();
    Halves out = data_;
    for (int p = 0; p < n_; ++p) {
      // Half a standard error of what each gains over the prediction is taken off; the sum of G^2 is half that of G.
      const Eigen::RowVectorXd price = (local.row(p) / 2 + share * share * all).cwiseSqrt() / 2;
      const MatrixXd prices = (price.replicate(all.size(), 1) + price.transpose().replicate(1, all.size())) / 2;
      const Eigen::VectorXd pi = simplex_minimum(matrix(sums.row(p)).array() - matrix(sums.row(p)).minCoeff() +
                                                 share * (frame.array() - frame.minCoeff()) + prices.array());
      for (size_t half = 0; half < 2; ++half)
        for (size_t c = 0; c < 3; ++c)
          for (size_t i = 0; i < n; ++i)
            out[half][c][p] += pi[static_cast<int>(i)] * (candidates_[i][half][c][p] - data_[half][c][p]);
    }
    return out;
  }

  // ---- Outliers.

  /// Draws outliers of the data in to a first fit of all columns in one window, the frame.
  void draw_outliers_in() {
    for (const Fit fit : {kPredicted, kShape, kAll}) standardise(fit);
    const Halves fit = fitted(columns_[kAll], data_, weights(), 0, 1e-4, 0, base_);
    const Values level = brightness_of_mean(fit).max(0.0), floor = 0.1 * (level * mask_).sum() / mask_.sum() * mask_;
    Values excess[2];
    for (size_t half = 0; half < 2; ++half)
      excess[half] = (mask_ > 0).select((brightness(data_[half]) - brightness_of_mean(fit)) / (level + floor), 0.0);
    const double limit = 8 * std::max(1.0, std::pow(frame_.number("samplesPerPixel").value_or(1) / 16, 0.25));
    const auto squares = [&](double most) -> Values {
      return (excess[0].abs().min(most).square() + excess[1].abs().min(most).square()) / 2;
    };
    double deviation = 1e15, next = 1e14;  // of the frame, without outliers
    for (; next < 0.999 * deviation; next = std::sqrt(squares(limit * deviation).sum() / mask_.sum())) deviation = next;
    const MatrixXd g = window(10), smooth = window(6);
    const Values local = (smooth * (g * (mask_ * squares(limit * deviation)).matrix())).array() /
                         (smooth * (g * mask_.matrix())).array();
    const Values most = limit * (local / 2 + deviation * deviation / 2).sqrt(), both = excess[0].min(excess[1]);
    for (int p = 0; p < n_; ++p) {
      const bool point = both[p] > most[p] && (near(p, 3) * (both > 0.25 * both[p]).cast<double>()).sum() <= 4;
      for (size_t half = 0; half < 2; ++half) {
        const double own = excess[half][p], bound = std::max(most[p], 3 * excess[1 - half][p]);
        if (mask_[p] > 0 && own > (point ? most[p] : bound))
          for (size_t c = 0; c < 3; ++c)
            data_[half][c][p] -=
                (1 - (point ? most[p] : std::min(own, bound)) / own) * (data_[half][c][p] - mean(fit, c)[p]);
      }
    }
  }

  const Layers& frame_;
  const int n_;
  const bool direct_;
  Values x_, y_, mask_, level_;  // level_: brightness as far as it is known
  std::array<std::vector<Colours>, kFits> columns_;
  size_t base_ = 0;           // the first of kAll: opacity, a constant, what shines through
  Halves data_, left_, sum_;  // outliers drawn in; what no fit explains so far; the fits
  std::vector<Halves> candidates_;
};

}  // namespace

ReferenceRegression reference_regression(const Layers& frame, const LayerName& signal) {
  return Reference(frame, signal).run();
}

}  // namespace brume::test
