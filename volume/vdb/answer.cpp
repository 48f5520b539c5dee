#include <fmt/format.h>

#include <atomic>

#include "base/error.h"
#include "volume/vdb/reading.h"

namespace brume::vdb {
namespace {

namespace fs = std::filesystem;

/// Packs the answer to a request. @throws InputError, and whatever OpenVDB throws over damaged contents
void answer(Reading& reading, VdbRequest& request, Packer& pack) {
  const fs::path path = request.path;
  const auto reply = [&](auto value) { pack(value); };
  switch (request.kind) {
    case VdbRequest::Kind::kInfo:
      return reply(read_summary(reading, path, /*values=*/true));
    case VdbRequest::Kind::kContents:
      return reply(read_summary(reading, path, /*values=*/false));
    case VdbRequest::Kind::kScalar:
      return reply(read_scalar(reading, path, request.options));
    case VdbRequest::Kind::kColour:
      return reply(read_colour(reading, path, request.grid));
    case VdbRequest::Kind::kVelocity:
      return reply(read_velocity(reading, path, request.grid));
    case VdbRequest::Kind::kWrite:
      return reply(write_leaves(request, reading.memory));
    case VdbRequest::Kind::kHalve:
      return reply(halve(reading, path, request.grid, request.output, request.part));
  }
}

/// The same; what goes wrong becomes a message.
/// @return the message; empty when all went well
std::string answer_or_explain(Reading& reading, VdbRequest& request, Packer& pack, VdbOutcome& outcome) {
  const auto message = [&](const std::string& what) { return fmt::format("{}: {}", request.path, what); };
  outcome = VdbOutcome::kRefused;
  try {
    answer(reading, request, pack);
    outcome = VdbOutcome::kAnswered;
    return {};
  } catch (const NoSuchGrid& error) {
    outcome = VdbOutcome::kNoSuchGrid;
    return error.what();
  } catch (const InputError& error) {
    return error.what();
  } catch (const std::bad_alloc&) {
    if (reading.limits && !reading.header.cramped)
      return message("damaged: reading it asks for more memory than a file of its size can need");
    outcome = VdbOutcome::kOutOfMemory;
    return request.path;
  } catch (const std::ios::failure&) {
    return message("truncated or damaged: the file ends where its contents go on");
  } catch (const std::exception& error) {
    // What TBB throws for a thread that cannot be started.
    if (std::string_view(error.what()).find("pthread_create") != std::string_view::npos) {
      outcome = VdbOutcome::kOutOfMemory;
      return request.path;
    }
    return message(
        fmt::format("damaged, or not readable by OpenVDB {}: {}", openvdb::getLibraryVersionString(), error.what()));
  }
}

}  // namespace
}  // namespace brume::vdb

void brume::answer_vdb_request(MemoryFile& file) {
  const Mapping beginning(file, 0, sizeof(ExchangeHeader), /*writable=*/true);
  auto& header = *reinterpret_cast<ExchangeHeader*>(beginning.data());
  header.begun = kExchangeVersion;
  if (header.asked_by != kExchangeVersion) return;  // who asks says what is wrong
  VdbRequest request;
  {
    Unpacker unpack(std::make_shared<Mapping>(file, 0, file.size(), /*writable=*/false), header.request_offset,
                    header.request_size);
    unpack(request);
  }
  const auto report = [&](double fraction) { std::atomic_ref(header.progress).store(fraction); };
  vdb::Reading reading{file, header, {request.threads, report, nullptr}};
  Packer reply(file), explanation(file);
  VdbOutcome outcome{};
  std::string message = vdb::answer_or_explain(reading, request, reply, outcome);
  reading.limits.reset();
  explanation(message);
  header.outcome = outcome;
  const std::string& bytes = message.empty() ? reply.bytes() : explanation.bytes();
  header.reply_offset = file.append(std::as_bytes(std::span(bytes)));
  header.reply_size = bytes.size();
}
