#pragma once
#include <memory>
#include <string>

#include "workflows/view/view_source.h"

namespace brume::web {

struct ServerOptions {
  std::string host = "127.0.0.1";  ///< address to listen on
  uint16_t port = 0;               ///< 0: one that is free
  bool keep = false;               ///< go on rendering when the last page has been gone for a minute
  std::string display_cube = {};   ///< through which the page shows pictures (cube_of); empty: its own curves
};

/// A page that shows a Viewer, over HTTP and a WebSocket. It answers only who knows the secret in its address, names
/// the host that it listens on, and comes from its own page.
class Server {
 public:
  /// Listens and begins to look at the scene, in threads of its own. @throws InputError: as Viewer; an address or port
  /// that cannot be listened on
  Server(const ViewOptions& view, const ServerOptions& options, const Host& host);
  ~Server();
  Server(Server&&) = delete;

  /// "http://127.0.0.1:41234/SECRET/"
  const std::string& address() const;

  class Implementation;

 private:
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace brume::web
