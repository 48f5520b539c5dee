#include "apps/view/server.h"

#include <fmt/format.h>
#include <unistd.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <filesystem>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <thread>

#include "apps/view/messages.h"
#include "apps/view/view_bundle.h"
#include "base/error.h"
#include "base/output_file.h"
#include "image/exr_io.h"

namespace brume::web {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
namespace fs = std::filesystem;
using tcp = asio::ip::tcp;
using namespace std::chrono_literals;

constexpr size_t kMostConnections = 32, kMostTexts = 64;
constexpr auto kPatience = 30s;      // a request that takes longer to arrive is refused
constexpr auto kWithoutPages = 60s;  // after the last page has closed, nothing more is rendered
constexpr auto kFileCheck = 500ms;

std::string new_secret() {
  std::random_device device;  // the system's
  std::string secret;
  for (int i = 0; i < 4; ++i) secret += fmt::format("{:08x}", device());
  return secret;
}

/// Compared without telling by its time where they differ.
bool same(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned char difference = 0;
  for (size_t i = 0; i < a.size(); ++i) difference |= static_cast<unsigned char>(a[i] ^ b[i]);
  return difference == 0;
}

const std::string kPage = R"(<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>brume view</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="view.css">
</head>
<body><div id="app"></div><script src="view.js"></script></body>
</html>
)";

using Request = http::request<http::string_body>;
using Response = http::response<http::string_body>;

/// An answer that lets no other page read or frame it.
struct Reply {
  Response response;

  explicit Reply(unsigned version) : response(http::status::ok, version) {
    response.set(http::field::cache_control, "no-store");
    response.set(http::field::x_frame_options, "DENY");
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Referrer-Policy", "no-referrer");
    response.set("Cross-Origin-Resource-Policy", "same-origin");
    response.set("Content-Security-Policy",
                 "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
                 "connect-src 'self' ws:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'");
  }
  Response& refuse(http::status status, const std::string& text) {
    response.result(status);
    return give("text/plain; charset=utf-8", text + "\n");
  }
  /// @param saved_as  the file's name, where the browser is to save it
  Response& give(const char* type, std::string body, const std::string& saved_as = "") {
    if (!saved_as.empty()) response.set(http::field::content_disposition, "attachment; filename=\"" + saved_as + "\"");
    response.set(http::field::content_type, type);
    response.body() = std::move(body);
    return response;
  }
};

}  // namespace

class Connection;

class Server::Implementation : public ViewListener {
 public:
  Implementation(const ViewOptions& view, const ServerOptions& options, const Host& host);
  ~Implementation() override;

  const std::string& address() const { return address_; }
  const std::string& secret() const { return secret_; }
  bool names_this(std::string_view host_header) const;
  bool comes_from_here(std::string_view origin) const;
  ViewSource& viewer() { return *viewer_; }
  Response answer(const Request& request);

  void joined(const std::shared_ptr<Connection>& connection);
  void left(const Connection* connection);
  /// The one whose look was last is shown what comes of it.
  void asks(const std::shared_ptr<Connection>& connection, const std::string& message);

  // ViewListener, from the viewer's thread.
  void scene(const ViewSceneText& scene) override { send_text("scene", text_of(scene)); }
  void picture(ViewPicture picture) override;
  void progress(const ViewProgress& progress) override {
    send_text("progress", progress_text(progress));
    if (progress.stage >= ViewStage::kSampling) answered(progress.id);
  }
  void problem(const ViewProblem& problem) override {
    send_text("problem", problem_text(problem));
    answered(problem.id);
  }
  void point(uint64_t id, std::optional<dvec3> position) override { send_text("point", point_text(id, position)); }

 private:
  Response file(std::string_view name, const std::optional<ViewLook>& look, Reply reply);
  Response frame(const std::optional<ViewLook>& look, Reply reply);
  void accept();
  void check_file();
  void leave_alone();
  /// Pages take turns: a look waits until that of another page has been answered once.
  void begin(const std::shared_ptr<Connection>& connection, ViewLook look);
  void answered(uint64_t id);
  void next_turn();
  /// @param kind  of which only the newest one is of use
  void send_text(const std::string& kind, std::string text);

  const ServerOptions options_;
  const std::string secret_ = new_secret();
  std::string address_, authority_;
  size_t open_ = 0;  // sockets
  asio::io_context context_{1};
  tcp::acceptor acceptor_{context_};
  asio::steady_timer file_timer_{context_}, alone_timer_{context_};
  std::set<std::shared_ptr<Connection>> connections_;
  std::weak_ptr<Connection> looking_;
  std::optional<uint64_t> unanswered_;  // the look's number
  std::deque<std::pair<std::weak_ptr<Connection>, ViewLook>> waiting_;
  std::unique_ptr<ViewSource> viewer_;
  std::thread thread_;
  friend class Connection;
};

/// A socket: requests for files, then perhaps a WebSocket. Over that go texts in order, and of each layer the newest
/// picture: a slow page gets fewer of them, and nothing piles up.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, Server::Implementation& server) : server_(server), stream_(std::move(socket)) {
    ++server_.open_;
  }
  ~Connection() { --server_.open_; }

  void read_request() {
    parser_.emplace();
    parser_->header_limit(8 * 1024);
    parser_->body_limit(kLongestMessage);
    stream_.expires_after(kPatience);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](beast::error_code error, size_t) {
      if (!error) self->answer();
    });
  }

  void send_text(const std::string& kind, std::string text) {
    if (kind == "scene") knows_scene_ = true;
    // In order: a problem is over with a scene that comes after it.
    if (kind != "point") std::erase_if(texts_, [&](const auto& waiting) { return waiting.first == kind; });
    if (texts_.size() < kMostTexts) texts_.emplace_back(kind, std::move(text));
    write();
  }
  void send_picture(const std::string& layer, std::shared_ptr<const std::string> bytes) {
    pictures_[layer] = std::move(bytes);
    write();
  }
  bool knows_scene() const { return knows_scene_; }
  /// What its page looks at.
  std::optional<ViewLook> look;
  void close() {
    beast::error_code ignored;
    beast::get_lowest_layer(web_ ? web_->next_layer() : stream_).socket().close(ignored);
  }

 private:
  void answer() {
    request_ = parser_->release();
    if (websocket::is_upgrade(request_)) {
      const Response refusal = server_.answer(request_);
      if (refusal.result() != http::status::ok) return respond(refusal);
      beast::get_lowest_layer(stream_).expires_never();
      web_.emplace(std::move(stream_));
      auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
      timeout.keep_alive_pings = true;
      web_->set_option(timeout);
      web_->read_message_max(kLongestMessage);
      web_->auto_fragment(false);  // a picture in pieces of 4 kB would take as long to send as to make
      web_->async_accept(request_, [self = shared_from_this()](beast::error_code error) {
        if (error) return;
        self->server_.joined(self);
        self->read_message();
      });
      return;
    }
    respond(server_.answer(request_));
  }

  void respond(Response response) {
    response_ = std::move(response);
    response_.keep_alive(request_.keep_alive());
    if (request_.method() == http::verb::head) {
      response_.content_length(response_.body().size());
      response_.body().clear();
    } else {
      response_.prepare_payload();
    }
    http::async_write(stream_, response_, [self = shared_from_this()](beast::error_code error, size_t) {
      if (!error && self->response_.keep_alive()) self->read_request();
    });
  }

  void read_message() {
    web_->async_read(buffer_, [self = shared_from_this()](beast::error_code error, size_t) {
      if (error) return self->server_.left(self.get());
      const std::string message = beast::buffers_to_string(self->buffer_.data());
      self->buffer_.consume(self->buffer_.size());
      self->server_.asks(self, message);
      self->read_message();
    });
  }

  void write() {
    if (writing_) return;
    if (!texts_.empty()) {
      now_ = std::make_shared<const std::string>(std::move(texts_.front().second));
      texts_.pop_front();
      web_->text(true);
    } else if (!pictures_.empty()) {
      now_ = std::move(pictures_.begin()->second);
      pictures_.erase(pictures_.begin());
      web_->binary(true);
    } else {
      return;
    }
    writing_ = true;
    web_->async_write(asio::buffer(*now_), [self = shared_from_this()](beast::error_code error, size_t) {
      self->writing_ = false;
      if (error) return self->server_.left(self.get());
      self->write();
    });
  }

  Server::Implementation& server_;
  beast::tcp_stream stream_;
  std::optional<websocket::stream<beast::tcp_stream>> web_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  Request request_;
  Response response_;
  std::deque<std::pair<std::string, std::string>> texts_;  // kind, text
  std::map<std::string, std::shared_ptr<const std::string>> pictures_;
  std::shared_ptr<const std::string> now_;
  bool writing_ = false, knows_scene_ = false;
};

Server::Implementation::Implementation(const ViewOptions& view, const ServerOptions& options, const Host& host)
    : options_(options) {
  beast::error_code error;
  const auto host_address = asio::ip::make_address(options.host == "localhost" ? "127.0.0.1" : options.host, error);
  if (error) throw InputError(fmt::format("--host {}: is no address such as 127.0.0.1 or ::1", options.host));
  const tcp::endpoint endpoint(host_address, options.port);
  const auto check = [&] {
    if (error)
      throw InputError(fmt::format("cannot listen on {} port {}: {}", options.host, options.port, error.message()));
  };
  acceptor_.open(endpoint.protocol(), error);
  check();
  acceptor_.set_option(tcp::acceptor::reuse_address(true), error);
  acceptor_.bind(endpoint, error);
  check();
  acceptor_.listen(asio::socket_base::max_listen_connections, error);
  check();
  const uint16_t port = acceptor_.local_endpoint().port();
  authority_ = host_address.is_v6() ? fmt::format("[{}]:{}", host_address.to_string(), port)
                                    : fmt::format("{}:{}", host_address.to_string(), port);
  address_ = fmt::format("http://{}/{}/", authority_, secret_);
  viewer_ = make_view_source(view, host, *this);
  accept();
  check_file();
  thread_ = std::thread([this] { context_.run(); });
}

Server::Implementation::~Implementation() {
  asio::post(context_, [this] {
    beast::error_code ignored;
    acceptor_.close(ignored);
    for (const auto& connection : connections_) connection->close();
    connections_.clear();
    context_.stop();
  });
  thread_.join();
  viewer_.reset();
}

/// A name that leads here from elsewhere is refused, so that no other page's name can be bent to this address.
bool Server::Implementation::names_this(std::string_view host_header) const {
  const uint16_t port = acceptor_.local_endpoint().port();
  const auto address = acceptor_.local_endpoint().address();
  if (host_header == authority_) return true;
  if (address.is_loopback() &&
      (host_header == fmt::format("localhost:{}", port) || host_header == fmt::format("127.0.0.1:{}", port)))
    return true;
  if (!address.is_unspecified()) return false;
  // Listening everywhere: any address in numbers is one of this machine's, names are not known.
  const size_t colon = host_header.rfind(':');
  if (colon == std::string_view::npos) return false;
  std::string name(host_header.substr(0, colon));
  if (name.starts_with('[') && name.ends_with(']')) name = name.substr(1, name.size() - 2);
  beast::error_code error;
  asio::ip::make_address(name, error);
  return (!error || name == "localhost") && host_header.substr(colon + 1) == std::to_string(port);
}

bool Server::Implementation::comes_from_here(std::string_view origin) const {
  return origin.starts_with("http://") && names_this(origin.substr(7));
}

Response Server::Implementation::answer(const Request& request) {
  Reply reply(request.version());
  const auto text = [](const beast::string_view& v) { return std::string_view(v.data(), v.size()); };
  if (!names_this(text(request[http::field::host])))
    return reply.refuse(http::status::forbidden, "another host is meant");
  const std::string_view origin = text(request[http::field::origin]);
  if (!origin.empty() && !comes_from_here(origin)) return reply.refuse(http::status::forbidden, "another page asks");
  const bool posted = request.method() == http::verb::post;
  if (request.method() != http::verb::get && request.method() != http::verb::head && !posted)
    return reply.refuse(http::status::method_not_allowed, "expected GET, or POST with a look");
  std::string_view target = text(request.target());
  target = target.substr(0, target.find('?'));
  const size_t slash = target.find('/', 1);
  if (target.empty() || target[0] != '/' || slash == std::string_view::npos ||
      !same(target.substr(1, slash - 1), secret_))
    return reply.refuse(http::status::not_found,
                        "nothing is here; the address that the program prints ends in a secret");
  const std::string_view name = target.substr(slash + 1);
  if (posted && origin.empty()) return reply.refuse(http::status::forbidden, "no page asks");
  // What is kept of a look is that very look, not what has been computed last.
  std::optional<ViewLook> look;
  if (posted) {
    try {
      auto wish = parse_message(request.body());
      if (auto* const wanted = std::get_if<ViewLook>(&wish)) look = std::move(*wanted);
    } catch (const InputError& problem) {
      return reply.refuse(http::status::bad_request, problem.what());
    }
    if (!look) return reply.refuse(http::status::bad_request, "expected a look");
  }
  if (websocket::is_upgrade(request)) {
    if (name != "live" || origin.empty()) return reply.refuse(http::status::forbidden, "no page asks");
    return connections_.size() < kMostConnections
               ? reply.response
               : reply.refuse(http::status::service_unavailable, "too many pages are open");
  }
  return file(name, look, std::move(reply));
}

Response Server::Implementation::file(std::string_view name, const std::optional<ViewLook>& look, Reply reply) {
  if (name.empty() && view_script.empty())
    return reply.refuse(http::status::not_implemented,
                        "this brume was built without its pages: Node.js and npm were not there");
  if (name.empty()) return reply.give("text/html; charset=utf-8", kPage);
  if (name == "view.js") return reply.give("text/javascript; charset=utf-8", std::string(view_script));
  if (name == "view.css") return reply.give("text/css; charset=utf-8", std::string(view_style));
  if (name == "display.cube") return reply.give("application/octet-stream", options_.display_cube);
  try {
    if (name == "frame.exr") return frame(look, std::move(reply));
    if (look && name == "mix")
      return reply.give("application/json; charset=utf-8", assignments_text(viewer_->mix_assignments(*look)));
    if (look && name == "command") return reply.give("text/plain; charset=utf-8", viewer_->command(*look));
    if (name == "scene.toml")
      return reply.give("application/toml; charset=utf-8", look ? viewer_->scene_text(*look) : viewer_->scene_text(),
                        "scene.toml");
  } catch (const InputError& problem) {
    return reply.refuse(http::status::conflict, problem.what());
  } catch (const std::exception& problem) {  // a request ends no program
    return reply.refuse(http::status::internal_server_error, problem.what());
  }
  return reply.refuse(http::status::not_found, "no such file");
}

Response Server::Implementation::frame(const std::optional<ViewLook>& look, Reply reply) {
  const std::shared_ptr<const Layers> frame = look ? viewer_->frame(*look) : viewer_->frame();
  // A page waits for it, which is no error.
  if (!frame)
    return reply.refuse(look ? http::status::accepted : http::status::not_found,
                        "no samples have been taken yet; let the picture rest");
  const fs::path file = fs::temp_directory_path() / fmt::format("brume-view-{}-{}.exr", getpid(), secret_.substr(0, 8));
  try {
    write_exr(file, *frame);
    std::string bytes = read_text(file);
    std::error_code ignored;
    fs::remove(file, ignored);
    return reply.give("image/x-exr", std::move(bytes), "frame.exr");
  } catch (const std::exception& problem) {
    return reply.refuse(http::status::internal_server_error, problem.what());
  }
}

void Server::Implementation::accept() {
  acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    if (!error && open_ < 2 * kMostConnections) std::make_shared<Connection>(std::move(socket), *this)->read_request();
    accept();
  });
}

void Server::Implementation::check_file() {
  file_timer_.expires_after(kFileCheck);
  file_timer_.async_wait([this](beast::error_code error) {
    if (error) return;
    viewer_->check_files();
    check_file();
  });
}

void Server::Implementation::leave_alone() {
  alone_timer_.expires_after(kWithoutPages);
  alone_timer_.async_wait([this](beast::error_code error) {
    if (!error && connections_.empty()) viewer_->pause();
  });
}

void Server::Implementation::joined(const std::shared_ptr<Connection>& connection) {
  connections_.insert(connection);
  alone_timer_.cancel();
}

void Server::Implementation::left(const Connection* connection) {
  const bool looked = looking_.lock().get() == connection;
  std::erase_if(connections_, [&](const auto& c) { return c.get() == connection; });
  if (looked) {
    next_turn();
    // A page that had to stop goes on.
    if (!looking_.lock() || !connections_.contains(looking_.lock())) {
      looking_.reset();
      for (const auto& other : connections_)
        if (other->look && !looking_.lock()) begin(other, *other->look);
    }
  }
  if (connections_.empty() && !options_.keep) leave_alone();
}

void Server::Implementation::asks(const std::shared_ptr<Connection>& connection, const std::string& message) {
  try {
    auto wish = parse_message(message);
    if (auto* const look = std::get_if<ViewLook>(&wish))
      begin(connection, std::move(*look));
    else if (looking_.lock() == connection)
      viewer_->probe(std::get<ViewProbe>(wish));
  } catch (const std::exception& error) {
    connection->send_text("problem", problem_text({0, error.what()}));
  }
}

void Server::Implementation::begin(const std::shared_ptr<Connection>& connection, ViewLook look) {
  connection->look = look;
  const auto other = looking_.lock();
  if (unanswered_ && other && other != connection && connections_.contains(other)) {
    std::erase_if(waiting_, [&](const auto& wish) { return wish.first.lock() == connection; });
    waiting_.emplace_back(connection, std::move(look));
    return;
  }
  if (other && other != connection && connections_.contains(other) && other->look)
    other->send_text("progress", elsewhere_text(other->look->id));
  looking_ = connection;
  unanswered_ = look.id;
  look.needs_scene = !connection->knows_scene();
  viewer_->look(std::move(look));
}

void Server::Implementation::answered(uint64_t id) {
  asio::post(context_, [this, id] {
    if (unanswered_ != id) return;
    next_turn();
  });
}

void Server::Implementation::next_turn() {
  unanswered_.reset();
  while (!waiting_.empty() && !unanswered_) {
    auto [connection, look] = std::move(waiting_.front());
    waiting_.pop_front();
    if (const auto alive = connection.lock(); alive && connections_.contains(alive)) begin(alive, std::move(look));
  }
}

void Server::Implementation::send_text(const std::string& kind, std::string text) {
  asio::post(context_, [this, kind, text = std::move(text)]() mutable {
    if (const auto connection = looking_.lock(); connection && connections_.contains(connection))
      connection->send_text(kind, std::move(text));
  });
}

void Server::Implementation::picture(ViewPicture picture) {
  const uint64_t id = picture.id;
  asio::post(context_, [this, picture = std::make_shared<const ViewPicture>(std::move(picture))] {
    if (const auto connection = looking_.lock(); connection && connections_.contains(connection))
      connection->send_picture(picture->layer, std::make_shared<const std::string>(bytes_of(*picture)));
  });
  answered(id);
}

Server::Server(const ViewOptions& view, const ServerOptions& options, const Host& host)
    : implementation_(std::make_unique<Implementation>(view, options, host)) {}
Server::~Server() = default;

const std::string& Server::address() const {
  return implementation_->address();
}

}  // namespace brume::web
