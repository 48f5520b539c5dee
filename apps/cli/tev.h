#pragma once
#include <string>

#include "workflows/render_frame.h"

namespace brume::app {

/// Shows a render as it grows in tev (https://github.com/Tom94/tev), over its network protocol.
class TevViewer : public RenderWatcher {
 public:
  /// @param address  host:port, host alone, or empty for 127.0.0.1:14158
  /// @throws InputError when dropped there
  TevViewer(const std::string& address, const std::string& name, int width, int height);
  ~TevViewer() override;
  TevViewer(TevViewer&&) = delete;

  /// Sends the pixels of one tile. A viewer that was closed ends the show, not the render.
  void update(const Film& film, int tile) override;
  /// Sends a whole frame's R G B A.
  void show(const Layers& frame) override;

 private:
  void send(const std::string& payload);
  void send_pixels(const Layers& frame, const PixelWindow& window);
  int socket_ = -1;
  std::string name_;
};

}  // namespace brume::app
