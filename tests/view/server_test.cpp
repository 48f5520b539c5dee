// The server of `brume view`: whom it answers, what it sends, that no byte sent to it does harm.

#include "apps/view/server.h"

#include <gtest/gtest.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstring>
#include <nlohmann/json.hpp>
#include <thread>

#include "apps/view/messages.h"
#include "base/error.h"
#include "base/peak_memory.h"
#include "base/rng.h"
#include "image/exr_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using nlohmann::json;
using tcp = asio::ip::tcp;

struct Running {
  web::Server server;
  std::string authority, secret;
  explicit Running(const web::ServerOptions& options = {}, const std::vector<std::string>& overrides = {})
      : Running(ViewOptions{.scene = test::source("data/scenes/cloud.toml"), .overrides = overrides}, options) {}
  explicit Running(const ViewOptions& view, const web::ServerOptions& options = {}) : server(view, options, {}) {
    const std::string address = server.address();
    const size_t slash = address.find('/', 7);
    authority = address.substr(7, slash - 7);
    secret = address.substr(slash + 1, address.size() - slash - 2);
  }
  tcp::endpoint endpoint() const {
    const size_t colon = authority.rfind(':');
    return {asio::ip::make_address(authority.substr(0, colon)),
            static_cast<unsigned short>(std::stoi(authority.substr(colon + 1)))};
  }
};

template <class Body>
http::response<http::string_body> answer_to(const Running& r, const http::request<Body>& request) {
  asio::io_context context;
  tcp::socket socket(context);
  socket.connect(r.endpoint());
  http::write(socket, request);
  beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  parser.body_limit(64 << 20);
  http::read(socket, buffer, parser);
  return parser.release();
}

/// What a page keeps: a request with a look.
http::response<http::string_body> post(const Running& r, const std::string& name, const std::string& body,
                                       bool of_page = true) {
  http::request<http::string_body> request(http::verb::post, "/" + r.secret + "/" + name, 11);
  request.set(http::field::host, r.authority);
  if (of_page) request.set(http::field::origin, "http://" + r.authority);
  request.body() = body;
  request.prepare_payload();
  return answer_to(r, request);
}

http::response<http::string_body> get(const Running& r, const std::string& target,
                                      std::map<std::string, std::string> fields = {},
                                      http::verb method = http::verb::get) {
  http::request<http::empty_body> request(method, target, 11);
  fields.try_emplace("Host", r.authority);
  for (const auto& [name, value] : fields) request.set(name, value);
  return answer_to(r, request);
}

/// A page's end of the WebSocket.
class Page {
 public:
  explicit Page(const Running& r, const std::string& origin = "") : web_(context_) {
    web_.next_layer().connect(r.endpoint());
    web_.set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
      request.set(http::field::origin, origin.empty() ? "http://" + r.authority : origin);
    }));
    web_.handshake(r.authority, "/" + r.secret + "/live");
  }
  void send(const json& message) { send_text(message.dump()); }
  void send_text(const std::string& text) { web_.write(asio::buffer(text)); }
  /// The next message: text, or a picture's header under "picture" and its bytes.
  json receive() {
    beast::flat_buffer buffer;
    web_.read(buffer);
    const std::string bytes = beast::buffers_to_string(buffer.data());
    if (web_.got_text()) return json::parse(bytes);
    uint32_t length = 0;
    std::memcpy(&length, bytes.data(), 4);
    json header = json::parse(bytes.substr(4, length));
    EXPECT_EQ(bytes.size(), 4 + length +
                                2u * header["width"].get<size_t>() * header["height"].get<size_t>() *
                                    header["channels"].get<size_t>());
    header["type"] = "picture";
    return header;
  }
  json receive_until(const std::function<bool(const json&)>& is) {
    for (;;)
      if (json message = receive(); is(message)) return message;
  }
  tcp::socket& socket() { return web_.next_layer(); }

 private:
  asio::io_context context_;
  websocket::stream<tcp::socket> web_;
};

json look(uint64_t id) {
  return {{"type", "look"},   {"id", id},        {"set", json::array()},
          {"size", {32, 24}}, {"moving", false}, {"layers", {"picture"}}};
}

TEST(ViewServer, AnswersALookWithScenePicturesAndProgress) {
  const Running r;
  Page page(r);
  page.send(look(3));
  bool scene = false, progress = false, picture = false;
  while (!scene || !progress || !picture) {
    const json message = page.receive();
    EXPECT_EQ(message["id"], 3);
    scene = scene || message["type"] == "scene";
    progress = progress || message["type"] == "progress";
    picture = picture || message["type"] == "picture";
    if (message["type"] != "scene") continue;
    EXPECT_EQ(message["name"], "cloud");
    const json& volume = *std::find_if(message["groups"].begin(), message["groups"].end(),
                                       [](const json& group) { return group["path"] == "volumes.0"; });
    EXPECT_EQ(volume["title"], "cloud.vdb");
    EXPECT_EQ(volume["grids"], json::array({"density"}));
    EXPECT_GT(volume["optical_depth"][0], 10);
    const json& file = *std::find_if(volume["fields"].begin(), volume["fields"].end(),
                                     [](const json& field) { return field["key"] == "file"; });
    EXPECT_EQ(file["fixed"], true);
  }
}

TEST(ViewServer, APageThatJoinsWhileSamplesGoOnIsToldTheScene) {
  const Running r;
  const auto clean = [](const json& m) { return m["type"] == "picture" && m["stage"] == "clean"; };
  const auto scene = [](const json& m) { return m["type"] == "scene"; };
  Page first(r);
  first.send(look(3));
  first.receive_until(clean);
  Page second(r);
  second.send(look(4));
  EXPECT_EQ(second.receive_until(scene)["id"], 4);
  second.receive_until(clean);
}

TEST(ViewServer, KeepsTheLookThatAPageSays) {
  const Running r;
  Page page(r);
  page.send(look(3));
  page.receive_until([](const json& m) { return m["type"] == "picture" && m["full"] == true; });
  json other = look(0);
  other["set"] = {"camera.fov=21"};
  EXPECT_NE(post(r, "scene.toml", other.dump()).body().find("fov = 21"), std::string::npos);
  EXPECT_NE(post(r, "command", other.dump()).body().find("camera.fov=21"), std::string::npos);
  // Its frame is not there, which is no error: a page waits.
  EXPECT_EQ(post(r, "frame.exr", other.dump()).result_int(), 202u);
  const auto frame = post(r, "frame.exr", look(0).dump());
  EXPECT_EQ(frame.result_int(), 200u);
  EXPECT_EQ(frame.body().substr(0, 4), std::string("\x76\x2f\x31\x01"));
  EXPECT_EQ(post(r, "scene.toml", "nonsense").result_int(), 400u);
  EXPECT_EQ(post(r, "scene.toml", R"({"type":"probe","id":1,"x":0.5,"y":0.5})").result_int(), 400u);
  other["set"] = {"volumes.0.nonsense=1"};
  EXPECT_EQ(post(r, "scene.toml", other.dump()).result_int(), 409u);
  EXPECT_EQ(post(r, "scene.toml", look(0).dump(), /*of_page=*/false).result_int(), 403u);
}

TEST(ViewServer, MixesLightGroups) {
  const Running r(web::ServerOptions{}, {"render.light_groups=true"});
  Page page(r);
  json mixed = look(3);
  mixed["mix"] = {{"sun", 0.5}, {"sky", {1, 2, 3}}};
  page.send(mixed);
  const json scene = page.receive_until([](const json& m) { return m["type"] == "scene"; });
  EXPECT_EQ(scene["light_groups"], json::array({"sky", "sun"}));
  const json picture = page.receive_until([](const json& m) { return m["type"] == "picture" && m["full"] == true; });
  EXPECT_FALSE(picture.contains("mixed"));
  const json lights = json::parse(post(r, "mix", mixed.dump()).body());
  ASSERT_EQ(lights.size(), 2u) << lights;
  EXPECT_TRUE(lights[0].get<std::string>().starts_with("environment.radiance=[")) << lights;
  EXPECT_TRUE(lights[1].get<std::string>().starts_with("lights.0.irradiance=[")) << lights;
  EXPECT_EQ(json::parse(post(r, "mix", look(3).dump()).body()), json::array());
  // What cannot be mixed is refused, and what can be goes on.
  json unknown = look(4);
  unknown["mix"] = {{"moon", 2}};
  for (const char* name : {"mix", "scene.toml", "command", "frame.exr"}) {
    const auto refused = post(r, name, unknown.dump());
    ASSERT_EQ(refused.result_int(), 409u) << name;
    EXPECT_NE(refused.body().find("no light group 'moon'"), std::string::npos) << refused.body();
  }
  page.send(unknown);
  EXPECT_EQ(page.receive_until([](const json& m) { return m["type"] == "problem"; })["id"], 4);
  mixed["id"] = 5;
  page.send(mixed);
  page.receive_until([](const json& m) { return m["type"] == "picture" && m["id"] == 5; });
}

TEST(ViewServer, ShowsAndMixesAFrame) {
  const test::TemporaryFolder folder;
  Layers frame(8, 6);
  for (const char* channel : {"R", "G", "B"}) {
    frame.add(channel, 3);
    frame.add(std::string("light.key.") + channel, 1);
    frame.add(std::string("light.rest.") + channel, 2);
  }
  frame.header["software"] = std::string("brume");
  write_exr(folder / "f.exr", frame);
  const Running r(ViewOptions{.scene = folder / "f.exr"});
  Page page(r);
  json mixed = look(3);
  mixed["mix"] = {{"key", 0.5}};
  page.send(mixed);
  const json scene = page.receive_until([](const json& m) { return m["type"] == "scene"; });
  EXPECT_EQ(scene["of"], "frames");
  EXPECT_EQ(scene["groups"], json::array());
  EXPECT_EQ(scene["light_groups"], json::array({"key", "rest"}));
  const json picture = page.receive_until([](const json& m) { return m["type"] == "picture"; });
  EXPECT_EQ(picture["width"], 8);
  page.send({{"type", "probe"}, {"id", 4}, {"x", 0.5}, {"y", 0.5}});
  EXPECT_EQ(page.receive_until([](const json& m) { return m["type"] == "point"; })["position"], nullptr);
  EXPECT_NE(post(r, "scene.toml", mixed.dump()).body().find("[mix]\nkey = [0.5, 0.5, 0.5]"), std::string::npos);
  EXPECT_NE(post(r, "command", mixed.dump()).body().find("--gain key=0.5"), std::string::npos);
  EXPECT_EQ(post(r, "frame.exr", mixed.dump()).result_int(), 200u);
  EXPECT_EQ(post(r, "mix", mixed.dump()).result_int(), 409u);
  mixed["mix"] = {{"moon", 2}};
  for (const char* name : {"scene.toml", "frame.exr"}) EXPECT_EQ(post(r, name, mixed.dump()).result_int(), 409u);
  page.send(mixed);
  EXPECT_NE(page.receive_until([](const json& m) { return m["type"] == "problem"; })["text"].get<std::string>().find(
                "no light group 'moon'"),
            std::string::npos);
}

TEST(ViewServer, APageWhoseTurnAnotherOneTakesIsToldAndGoesOnAfterIt) {
  const Running r;
  const auto clean = [](const json& m) { return m["type"] == "picture" && m["stage"] == "clean"; };
  Page first(r);
  first.send(look(3));
  first.receive_until(clean);
  {
    Page second(r);
    json other = look(4);
    other["set"] = {"camera.fov=21"};
    second.send(other);
    second.receive_until(clean);
    first.receive_until([](const json& m) { return m["type"] == "progress" && m["stage"] == "elsewhere"; });
  }
  EXPECT_EQ(first.receive_until(clean)["id"], 3);
}

TEST(ViewServer, AnswersOnlyItsOwnPage) {
  const Running r;
  const std::string folder = "/" + r.secret + "/";
  EXPECT_EQ(get(r, folder + "scene.toml").result_int(), 200u);
  EXPECT_EQ(get(r, folder + "frame.exr").result_int(), 404u);
  for (const std::string& target :
       {std::string("/"), std::string("/scene.toml"), "/" + r.secret.substr(1) + "/scene.toml",
        "/" + r.secret + "x/scene.toml", "/" + r.secret, folder + "../" + r.secret + "/scene.toml",
        folder + "etc/passwd", folder + "../../../../etc/passwd", folder + "%2e%2e/passwd"}) {
    const auto response = get(r, target);
    EXPECT_EQ(response.result_int(), 404u) << target;
    EXPECT_EQ(response.body().find(r.secret), std::string::npos) << target;
  }
  for (const char* host : {"example.com", "127.0.0.1", "127.0.0.1:1", "localhost.example.com:80", ""})
    EXPECT_EQ(get(r, folder + "scene.toml", {{"Host", host}}).result_int(), 403u) << host;
  EXPECT_EQ(get(r, folder + "scene.toml", {{"Origin", "http://example.com"}}).result_int(), 403u);
  EXPECT_EQ(get(r, folder + "scene.toml", {}, http::verb::delete_).result_int(), 405u);
  for (const char* origin : {"http://example.com", "https://127.0.0.1", "null"})
    EXPECT_THROW(Page(r, origin), boost::system::system_error) << origin;
  EXPECT_NE(get(r, folder)["Content-Security-Policy"].find("default-src 'none'"), beast::string_view::npos);
}

TEST(ViewServer, GivesTheDisplayThatPicturesAreShownThrough) {
  for (const std::string cube : {"", "a cube"}) {
    web::ServerOptions options;
    options.display_cube = cube;
    const Running r(options);
    const auto response = get(r, "/" + r.secret + "/display.cube");
    EXPECT_EQ(response.result_int(), 200u);
    EXPECT_EQ(response.body(), cube);
  }
}

// A page that reads nothing: the server keeps the newest picture for it and answers others in turn.
TEST(ViewServer, ASlowPageNeitherSlowsNorFillsAnything) {
  const Running r;
  Page slow(r);
  slow.socket().set_option(asio::socket_base::receive_buffer_size(4096));
  for (uint64_t id = 1; id <= 300; ++id) {
    json wish = look(id);
    wish["size"] = {200, 150};
    wish["moving"] = true;
    slow.send(wish);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  Page quick(r);
  quick.send(look(1000));
  const auto is_complete = [](const json& m) { return m["type"] == "picture" && m["full"] == true; };
  const json complete = quick.receive_until([&](const json& m) {
    // On a busy machine looks of the slow page may still arrive after this one, and the last look is shown.
    if (m["type"] == "progress" && m["stage"] == "elsewhere") quick.send(look(1000));
    return is_complete(m);
  });
  EXPECT_EQ(complete["id"], 1000);
  // What reaches the slow one then is the newest.
  slow.send(look(2000));
  slow.receive_until([](const json& m) { return m["type"] == "picture" && m["id"] == 2000; });
}

TEST(ViewServer, WrongMessagesAreAnsweredAndTheRightOneAfterThem) {
  const Running r;
  Page page(r);
  for (const char* wrong : {"", "x", "[]", "{}", "{\"type\":\"look\"}", "{\"type\":7}", "{\"type\":\"look\",\"id\":-1}",
                            "{\"type\":\"probe\",\"id\":1,\"x\":2,\"y\":0}",
                            "{\"type\":\"look\",\"id\":1,\"set\":[1],\"size\":[3,3],\"layers\":[]}",
                            "{\"type\":\"look\",\"id\":1,\"set\":[],\"size\":[100000,3],\"layers\":[]}",
                            "{\"type\":\"look\",\"id\":1,\"set\":[],\"size\":[3,3],\"layers\":[],\"samples\":-2}",
                            R"({"type":"look","id":1,"set":[],"size":[3,3],"layers":[],"mix":2})",
                            R"({"type":"look","id":1,"set":[],"size":[3,3],"layers":[],"mix":{"key":-1}})",
                            R"({"type":"look","id":1,"set":[],"size":[3,3],"layers":[],"mix":{"key":1e7}})",
                            R"({"type":"look","id":1,"set":[],"size":[3,3],"layers":[],"mix":{"key":[1,2]}})",
                            R"({"type":"look","id":1,"set":[],"size":[3,3],"layers":[],"mix":{"key":"2"}})"}) {
    page.send_text(wrong);
    EXPECT_EQ(page.receive()["type"], "problem") << wrong;
  }
  page.send(look(1));
  page.receive_until([](const json& m) { return m["type"] == "picture"; });
}

/// Random bytes, a right message with bytes changed, or with pieces of others.
std::string mutated(const std::string& text, Rng& rng) {
  std::string result = text;
  const int changes = 1 + static_cast<int>(rng.uniform() * 8);
  for (int i = 0; i < changes && !result.empty(); ++i) {
    const auto at = static_cast<size_t>(rng.uniform() * static_cast<double>(result.size()));
    switch (static_cast<int>(rng.uniform() * 4)) {
      case 0:
        result[at] = static_cast<char>(rng.uniform() * 256);
        break;
      case 1:
        result.erase(at, static_cast<size_t>(rng.uniform() * 6));
        break;
      case 2:
        result.insert(at, 1 + static_cast<size_t>(rng.uniform() * 40),
                      "{[\",:0-e}]"[static_cast<int>(rng.uniform() * 10)]);
        break;
      default:
        result.insert(at, text.substr(static_cast<size_t>(rng.uniform() * static_cast<double>(text.size()))));
    }
  }
  return result;
}

TEST(ViewMessages, AHundredThousandWrongOnesAreRefusedOrUnderstood) {
  const std::string texts[] = {
      look(12).dump(), R"({"type":"probe","id":18,"x":0.5,"y":0.25})",
      R"({"type":"look","id":17,"set":["camera.position=[0,-6,1]","lights.0.irradiance=[3,3,2]"],"size":[640,480],"moving":true,"layers":["picture","noisy"],"frame":12})",
      R"({"type":"look","id":17,"set":[],"size":[640,480],"layers":["picture"],"mix":{"key":2,"rim":[1,0.5,0]}})"};
  Rng rng(31);
  int understood = 0;
  for (int i = 0; i < 100000; ++i) {
    try {
      const auto wish = web::parse_message(mutated(texts[i % 4], rng));
      ++understood;
      if (const auto* const l = std::get_if<ViewLook>(&wish)) {
        EXPECT_LE(l->assignments.size(), web::kMostAssignments);
        EXPECT_LE(l->layers.size(), web::kMostLayers);
        EXPECT_LE(std::max(l->size.x, l->size.y), web::kLargestSide);
        for (const auto& [group, gain] : l->mix)
          EXPECT_TRUE(std::min({gain.x, gain.y, gain.z}) >= 0 && std::max({gain.x, gain.y, gain.z}) <= web::kMostGain);
      }
    } catch (const InputError&) {
    }
  }
  EXPECT_GT(understood, 100);
  EXPECT_LT(understood, 99000);
  EXPECT_THROW(web::parse_message(std::string(60000, '[')), InputError);
  EXPECT_THROW(web::parse_message(std::string(70000, ' ')), InputError);
}

/// Bytes to the socket itself: no HTTP, broken HTTP, a WebSocket whose frames are broken.
TEST(ViewServer, BrokenRequestsAndFramesHarmNothing) {
  const Running r;
  Rng rng(5);
  const std::string request = "GET /" + r.secret + "/live HTTP/1.1\r\nHost: " + r.authority + "\r\nOrigin: http://" +
                              r.authority +
                              "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                              "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
  const std::string body = look(4).dump();
  std::string frame = {static_cast<char>(0x81), static_cast<char>(0x80 | body.size()), 0, 0, 0, 0};
  frame += body;
  ASSERT_LT(body.size(), 126u);
  for (int i = 0; i < 600; ++i) {
    asio::io_context context;
    tcp::socket socket(context);
    beast::error_code error;
    socket.connect(r.endpoint(), error);
    ASSERT_FALSE(error) << i << ": " << error.message();
    const std::string bytes = i % 2 == 0 ? mutated(request, rng) : request + mutated(frame, rng) + mutated(frame, rng);
    asio::write(socket, asio::buffer(bytes), error);
    if (i % 3 == 0) {  // others go without a word
      socket.shutdown(tcp::socket::shutdown_send, error);
      char buffer[256];
      socket.non_blocking(true);
      socket.read_some(asio::buffer(buffer), error);
    }
  }
  Page page(r);
  page.send(look(5));
  page.receive_until([](const json& m) { return m["type"] == "picture" && m["id"] == 5; });
}

TEST(ViewServer, MemoryStaysAsItIsUnderLongDragging) {
  const Running r;
  Page page(r);
  const auto drag = [&](int first, int count) {
    for (int i = first; i < first + count; ++i) {
      json wish = look(static_cast<uint64_t>(i));
      wish["moving"] = true;
      wish["set"] = {"camera.position=[" + std::to_string(0.01 * i) + ", -6, 1]",
                     "lights.0.direction=[" + std::to_string(0.05 * (i / 12 % 5)) + ", 0, 1]"};
      page.send(wish);
      page.receive_until([&](const json& m) { return m["type"] == "picture" && m["id"] == i; });
    }
  };
  drag(1, 40);
  const PeakMemory peak;
  drag(41, 80);
  if (const std::optional<double> growth = peak.growth()) {
    EXPECT_LT(*growth, 64e6);
  }
}

}  // namespace
}  // namespace brume
