#include "apps/cli/tev.h"

#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>

#include "apps/cli/command.h"
#include "base/error.h"

namespace brume::app {
namespace {

// Packets are little-endian: length of all of it, type, fields; strings end in 0.
enum class Packet : uint8_t { kCreateImage = 4, kUpdateImageV3 = 6 };

class Payload {
 public:
  explicit Payload(Packet type) {
    add(static_cast<uint8_t>(type));
    add(uint8_t{0});  // does not grab the focus
  }
  template <class T>
  void add(T value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    text_.append(bytes, sizeof value);
  }
  void add_text(const std::string& text) { text_.append(text.c_str(), text.size() + 1); }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

constexpr const char* kChannels[] = {"R", "G", "B", "A"};

}  // namespace

TevViewer::TevViewer(const std::string& address, const std::string& name, int width, int height) : name_(name) {
  const size_t colon = address.rfind(':');
  const std::string host = address.empty() || colon == 0 ? "127.0.0.1" : address.substr(0, colon);
  const std::string port = colon == std::string::npos ? "14158" : address.substr(colon + 1);
  addrinfo hints{}, *found = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  if (getaddrinfo(host.c_str(), port.c_str(), &hints, &found) == 0) {
    for (const addrinfo* a = found; a && socket_ < 0; a = a->ai_next) {
      socket_ = ::socket(a->ai_family, a->ai_socktype | SOCK_CLOEXEC, a->ai_protocol);
      if (socket_ >= 0 && connect(socket_, a->ai_addr, a->ai_addrlen) != 0) {
        close(socket_);
        socket_ = -1;
      }
    }
    freeaddrinfo(found);
  }
  if (socket_ < 0)
    throw InputError(fmt::format("--tev: nobody listens at {}:{}; start tev first, or say where it runs", host, port));
  Payload create(Packet::kCreateImage);
  create.add_text(name_);
  create.add(static_cast<int32_t>(width));
  create.add(static_cast<int32_t>(height));
  create.add(static_cast<int32_t>(std::size(kChannels)));
  for (const char* channel : kChannels) create.add_text(channel);
  send(create.text());
}

TevViewer::~TevViewer() {
  if (socket_ >= 0) close(socket_);
}

void TevViewer::send(const std::string& payload) {
  if (socket_ < 0) return;
  const auto length = static_cast<uint32_t>(payload.size() + sizeof(uint32_t));
  std::string packet(reinterpret_cast<const char*>(&length), sizeof length);
  packet += payload;
  for (size_t sent = 0; sent < packet.size();) {
    const ssize_t n = ::send(socket_, packet.data() + sent, packet.size() - sent, MSG_NOSIGNAL);
    if (n <= 0) {
      note("tev was closed; the render goes on");
      close(socket_);
      socket_ = -1;
      return;
    }
    sent += static_cast<size_t>(n);
  }
}

void TevViewer::update(const Film& film, int tile) {
  const Film::Bounds b = film.bounds(tile);
  send_pixels(film.layers(), {{b.x0, b.y0}, {b.x1, b.y1}});
}

void TevViewer::show(const Layers& frame) {
  if (frame.has(layer::beauty)) send_pixels(frame, {{0, 0}, {frame.width(), frame.height()}});
}

void TevViewer::send_pixels(const Layers& frame, const PixelWindow& window) {
  if (socket_ < 0) return;
  constexpr size_t kCount = std::size(kChannels);
  Payload packet(Packet::kUpdateImageV3);
  packet.add_text(name_);
  packet.add(static_cast<int32_t>(kCount));
  for (const char* channel : kChannels) packet.add_text(channel);
  for (const int value : {window.lo.x, window.lo.y, window.width(), window.height()})
    packet.add(static_cast<int32_t>(value));
  for (size_t c = 0; c < kCount; ++c) packet.add(static_cast<int64_t>(c));
  for (size_t c = 0; c < kCount; ++c) packet.add(static_cast<int64_t>(kCount));
  const Plane* planes[kCount];
  for (size_t c = 0; c < kCount; ++c) planes[c] = &frame.at(kChannels[c]);
  for (int y = window.lo.y; y < window.hi.y; ++y)
    for (int x = window.lo.x; x < window.hi.x; ++x)
      for (const Plane* plane : planes) packet.add((*plane)(x, y));
  send(packet.text());
}

}  // namespace brume::app
