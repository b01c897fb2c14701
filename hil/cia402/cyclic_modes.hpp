#pragma once

#include <tribotwin/hil/cia402/modes.hpp>

/// Functions of the cyclic synchronous modes, for the table in modes.cc: CSP, CSV, CST.
namespace tribotwin::hil::cyclic {

void csp_target(Demand& demand, const DriveObjects& objects);
twin::DriveCommand csp(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
twin::DriveCommand csv(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
twin::DriveCommand cst(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
int status(const Demand& demand);

}  // namespace tribotwin::hil::cyclic
