#include <algorithm>
#include <cassert>
#include <csignal>
#include <thread>
#include <variant>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <fmt/format.h>

#include <tribotwin/twin/live/connection.hpp>
#include <tribotwin/twin/live/protocol/geometry.hpp>
#include <tribotwin/twin/live/viewer.hpp>

namespace tribotwin::twin::live {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;

namespace {

constexpr std::size_t rows_on_the_way = 8192;

Text shared(std::string text) { return std::make_shared<const std::string>(std::move(text)); }

/// Signals are for the thread that runs the program: they end its waits.
class SignalsBlocked {
 public:
  SignalsBlocked() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

 private:
  sigset_t before_;
};

}  // namespace

struct Server::Impl {
  Impl(const ServerOptions& options, Hello hello)
      : rows(hello.columns.size(), rows_on_the_way), poses(hello.bodies * pose_numbers) {
    hub.options = options;
    if (!hub.options.room) hub.options.room = room_for_pages;
    hub.hello = std::move(hello);
    if (!options.folder.empty() && hub.hello.head && !options.readonly) make_files();
  }

  void make_files() {
    for (const char* command : {"record", "export"}) hub.hello.commands.emplace_back(command);
    hub.files = std::make_unique<RowFiles>(
        RowFiles::Options{hub.options.folder, *hub.hello.head, hub.options.limits.memory_bytes,
                          [this] { return hub.options.room(hub.options.folder); }},
        RowFiles::Ways{[this](std::function<void()> call) { asio::post(io, std::move(call)); },
                       [this](const Done& done) { pass_on(done); }, [this](const Event& event) { pass_on(event); }});
  }

  /// What is recorded or exported is written to its end; what came of it is told before the farewell.
  bool files_are_closed() {
    if (!hub.files || !hub.files->busy()) return true;
    hub.files->end();
    end_at = Clock::now() + hub.options.limits.farewell;
    return false;
  }

  Result<void> open() {
    const Address& address = hub.options.address;
    const tcp::endpoint wanted(asio::ip::make_address(address.host), address.port);
    error_code error;
    const auto ok = [&](auto&& call) {
      if (!error) call();
    };
    ok([&] { acceptor.open(wanted.protocol(), error); });
    ok([&] { acceptor.set_option(tcp::acceptor::reuse_address(true), error); });
    if (wanted.address().is_v6()) ok([&] { acceptor.set_option(asio::ip::v6_only(true), error); });
    ok([&] { acceptor.bind(wanted, error); });
    ok([&] { acceptor.listen(tcp::acceptor::max_listen_connections, error); });
    if (error)
      return tl::unexpected(Error(fmt::format("{}: {}; choose another address, or port 0 for any port that is free",
                                              authority(address.host, address.port), error.message())));
    return name();
  }

  Result<void> name() {
    const Address& address = hub.options.address;
    url = fmt::format("http://{}/", authority(address.host, acceptor.local_endpoint().port()));
    const auto session = new_token();
    if (!session) return tl::unexpected(session.error());
    hub.hello_text = shared(to_json(hub.hello, *session, hub.options.readonly));
    hub.foxglove_topics = foxglove::Topics(hub.hello);
    hub.foxglove_info = shared(foxglove::server_info(hub.hello, *session));
    hub.foxglove_channels = shared(hub.foxglove_topics.advertisement());
    if (address.loopback) return {};
    auto token = new_token();
    if (!token) return tl::unexpected(token.error());
    hub.token = *std::move(token);
    url += "?token=" + hub.token;
    return {};
  }

  void run() {
    accept();
    tick();
    const SignalsBlocked blocked;
    thread = std::thread([this] { io.run(); });
  }

  void end() {
    asio::post(io, [this] { end_at = Clock::now() + hub.options.limits.farewell; });
    thread.join();
    hub.viewers.clear();  // before the context of their sockets
    hub.files.reset();
  }

  void accept() {
    acceptor.async_accept([this](error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) return accept_later();
      if (hub.connections < hub.options.limits.connections) serve(hub, std::move(socket));
      accept();
    });
  }

  /// No descriptor is free.
  void accept_later() {
    pause.expires_after(std::chrono::milliseconds(100));
    pause.async_wait([this](error_code error) {
      if (!error) accept();
    });
  }

  void tick() {
    timer.expires_after(std::chrono::nanoseconds(std::chrono::seconds(1)) / hub.options.limits.batches_per_s);
    timer.async_wait([this](error_code) {
      pass_on();
      if (end_at && files_are_closed() && may_end()) return io.stop();
      tick();
    });
  }

  /// Evaluated here, not on the thread of the steps.
  void tell_laws() {
    if (Clock::now() < laws_due || joints.empty()) return;
    laws_due = Clock::now() + law_period;
    std::vector<Text> laws(joints.size());
    for (const auto& viewer : hub.viewers) {
      if (!viewer->watched() || *viewer->watched() >= laws.size()) continue;
      Text& law = laws[*viewer->watched()];
      if (!law) law = shared(to_json(hub.hello.law(*viewer->watched(), joints[*viewer->watched()])));
      viewer->tell_law(law);
    }
  }

  /// Of every so many ticks: the rate of rows is that of the ticks.
  void tell_poses() {
    const Limits& limits = hub.options.limits;
    if (++ticks % std::max(1, limits.batches_per_s / std::max(1, limits.poses_per_s)) != 0) return;
    const bool fresh = poses.read(
        [this](std::uint64_t number, std::span<const float> values) { hub.poses = pose_message(number, values); });
    if (!fresh) return;
    for (const auto& viewer : hub.viewers) viewer->tell_poses(hub.poses);
  }

  /// What the thread of the steps said, to all viewers.
  void pass_on() {
    while (auto message = messages.take()) std::visit([this](auto& what) { pass_on(what); }, *message);
    while (auto answer = answers.take()) pass_on(*answer);
    rows.drain([this](std::uint64_t number, std::span<const double> row) {
      for (const auto& viewer : hub.viewers) viewer->add_row(number, row);
      if (hub.files) hub.files->add(number, row);
    });
    if (hub.files) hub.files->send();
    tell_laws();
    tell_poses();
    for (const auto& viewer : hub.viewers) viewer->send_rows();
  }
  void pass_on(Status& status) {
    if (const RowFile* file = hub.files ? hub.files->recording() : nullptr) status.file = *file;
    hub.status = {shared(to_json(status)), status.simulated_s};
    joints = status.joints;
    for (const auto& viewer : hub.viewers) viewer->tell_status(hub.status);
  }
  void pass_on(const Event& event) {
    hub.events.push_back({shared(to_json(event)), event.time_s});
    if (hub.events.size() > hub.options.limits.events) hub.events.pop_front();
    for (const auto& viewer : hub.viewers) viewer->tell_event(hub.events.back());
  }
  void pass_on(const Done& done) {
    const Text text = shared(to_json(done));
    for (const auto& viewer : hub.viewers)
      if (viewer->number() == done.viewer) viewer->tell(text);
  }

  /// Viewers get what is left, and a word that this is the end.
  bool may_end() {
    error_code ignored;
    acceptor.close(ignored);
    const bool late = Clock::now() >= *end_at;
    if (hub.viewers.empty() || (late && farewell_said)) return true;
    const bool idle = std::ranges::all_of(hub.viewers, [](const auto& viewer) { return viewer->idle(); });
    if (farewell_said || !(idle || late)) return false;
    farewell_said = true;
    end_at = Clock::now() + hub.options.limits.farewell;
    for (const auto& viewer : std::vector(hub.viewers)) viewer->close(Viewer::CloseCode::going_away, "the end");
    return false;
  }

  Hub hub;
  RowRing rows;
  Newest poses;
  int ticks = 0;
  Queue<std::variant<Status, Event>, 256> messages;
  std::uint64_t lost_events = 0;  // of the thread of the steps
  Queue<Done, 64> answers;
  std::string url;
  asio::io_context io{1};
  tcp::acceptor acceptor{io};
  asio::steady_timer timer{io}, pause{io};
  std::thread thread;
  std::vector<drive::Workspace> joints;  // as of the last status
  Clock::time_point laws_due;
  std::optional<Clock::time_point> end_at;
  bool farewell_said = false;
};

Server::Server(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Server::~Server() { impl_->end(); }

Result<std::unique_ptr<Server>> Server::start(const ServerOptions& options, Hello hello) {
  auto impl = std::make_unique<Impl>(options, std::move(hello));
  if (auto ok = impl->open(); !ok) return tl::unexpected(ok.error());
  impl->run();
  return std::unique_ptr<Server>(new Server(std::move(impl)));
}

const std::string& Server::url() const { return impl_->url; }
RowRing& Server::rows() { return impl_->rows; }
Newest& Server::poses() { return impl_->poses; }
void Server::tell(Status status) {
  status.lost_events = impl_->lost_events;
  impl_->messages.push(std::move(status));
}
void Server::tell(Event event) { impl_->lost_events += !impl_->messages.push(std::move(event)); }
void Server::tell(Done done) {
  const bool told = impl_->answers.push(std::move(done));
  assert(told), (void)told;
}
std::optional<Command> Server::take() { return impl_->answers.has_room() ? impl_->hub.commands.take() : std::nullopt; }

}  // namespace tribotwin::twin::live
