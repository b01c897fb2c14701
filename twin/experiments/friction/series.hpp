#pragma once

#include <set>
#include <string>

#include <tribotwin/twin/experiments/friction/campaign.hpp>
#include <tribotwin/twin/io/input.hpp>

/// Internal to this folder, not installed.
namespace tribotwin::twin {

/// Adds the curves of one entry of `series`, number `index`, to the campaign. `basis`: what all series have in common.
/// `names` receives the name of the series. For readers: throws InputError.
void add_series(Campaign& campaign, const Measurement& basis, std::set<std::string>& names, std::size_t index,
                Mapping in);

}  // namespace tribotwin::twin
