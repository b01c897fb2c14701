#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/twin/io/mcap/joint_json.hpp>
#include <tribotwin/twin/live/protocol/messages.hpp>

/// The WebSocket protocol of Foxglove, which Lichtblick speaks too: what is said in it, without sockets. Offered are
/// subscriptions and the time of the run. Texts are JSON objects with `op`; binary messages begin with an operation
/// code: 1, number of the subscription (u32), time (u64 [ns]) and a message; 2 and the time (u64 [ns]); little endian.
namespace tribotwin::twin::live::foxglove {

/// Of Foxglove's ws-protocol and of the Foxglove SDK. What is offered here is the same in both.
inline constexpr std::string_view subprotocols[] = {"foxglove.websocket.v1", "foxglove.sdk.v1"};

/// The topics of a bench: one per joint, then /status and /events.
class Topics {
 public:
  Topics() = default;
  explicit Topics(const Hello& hello);

  std::size_t size() const { return joints_.size() + 2; }
  std::size_t status() const { return joints_.size(); }
  std::size_t events() const { return joints_.size() + 1; }
  bool is_joint(std::size_t topic) const { return topic < joints_.size(); }
  /// Channels have the numbers of their topics and 1.
  std::string advertisement() const;
  /// The message of a joint's topic, of a row as hello.columns says.
  void append_joint(std::string& out, std::size_t topic, std::span<const double> row) const;

 private:
  struct Joint {
    std::string name;
    std::vector<std::size_t> columns;
    mcap::JointJson json;
  };
  std::vector<Joint> joints_;
};

std::string server_info(const Hello& hello, const std::string& session);

enum class Level { info, warning, error };
/// `id`: replaces what was said with it before.
std::string status_text(Level level, const std::string& message, const std::string& id = {});

std::uint64_t ns_of(double time_s);
/// The beginning of a message of a topic, and the time.
std::string message_head(std::uint32_t subscription, std::uint64_t ns);
std::string time_message(std::uint64_t ns);

/// What one client has subscribed to.
class Subscriptions {
 public:
  struct Subscription {
    std::uint32_t id;
    std::size_t topic;
  };
  struct Heard {
    std::vector<std::string> answers;  ///< what was wrong, as texts for the client
    std::vector<Subscription> added;
  };
  /// Obeys a text of the client.
  Heard hear(const Topics& topics, const std::string& text);
  /// Of a topic; nullptr: it has none.
  const Subscription* find(std::size_t topic) const;
  const std::vector<Subscription>& all() const { return all_; }

 private:
  void subscribe(const Topics& topics, const nlohmann::json& wanted, Heard& heard);
  void unsubscribe(const nlohmann::json& id, Heard& heard);
  std::vector<Subscription> all_;  // at most one per topic
};

}  // namespace tribotwin::twin::live::foxglove
