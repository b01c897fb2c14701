#pragma once

#include <functional>
#include <map>
#include <string>

#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/live/server.hpp>

/// What the commands of a page do.
namespace tribotwin::twin::live {

/// Obeys a command with these keys: the text of its answer. Throws InputError where it is refused.
using Act = std::function<std::string(Mapping& keys)>;
/// By the names that hello.commands has.
using Acts = std::map<std::string, Act>;

/// Obeys the commands of the pages that wait: `marker`, and those of `acts`. For the thread of the steps, at simulated
/// time `time_s`.
void obey(Server& server, double time_s, const Acts& acts = {});

}  // namespace tribotwin::twin::live
