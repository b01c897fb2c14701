#include <exception>
#include <utility>

#include <tribotwin/twin/numerics/executor/crew.hpp>

namespace tribotwin::twin {

Crew::Done perform(const Crew::Work& work, const Crew::Job& job, const std::atomic<bool>* stop) {
  if (stop && *stop) return {.task = job.task, .result = {}, .stopped = true};
  const auto started = std::chrono::steady_clock::now();
  Crew::Done done{.task = job.task, .result = {}};
  try {
    done.result = work(job.task, job.input);
  } catch (const std::exception& e) {
    done.result = work_failed(e.what());
  } catch (...) {
    done.result = work_failed("ended with an exception of an unknown kind");
  }
  done.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  done.stopped = !done.result && stop && *stop;
  return done;
}

void put(BytesOut& out, const Crew::Done& done) {
  out.put<std::uint64_t>(done.task).put(done.seconds).put(done.stopped).put(done.result.has_value());
  if (done.result)
    out.put(std::string_view(*done.result));
  else
    out.put(done.result.error().kind).put(std::string_view(done.result.error().message));
}

Crew::Done get_done(BytesIn& in) {
  Crew::Done done{.task = in.get<std::uint64_t>(), .result = {}};
  done.seconds = in.get<double>();
  done.stopped = in.get<bool>();
  if (in.get<bool>()) {
    done.result = in.text();
  } else {
    const auto kind = in.get<ErrorKind>();
    done.result = tl::unexpected(Error(in.text(), kind));
  }
  return done;
}

}  // namespace tribotwin::twin
