#pragma once

#include <tribotwin/hil/cia402/modes.hpp>

/// Functions of the cyclic synchronous modes, and of the interpolated position mode, for the table in
/// modes.cc.
namespace tribotwin::hil::cyclic {

void csp_target(Demand& demand, const DriveObjects& objects);
twin::DriveCommand csp(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
twin::DriveCommand csv(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
twin::DriveCommand cst(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
int status(const Demand& demand);

/// IP: as CSP, with its own target, while bit 4 of the controlword is set; else it stops along 6084h.
void ip_enter(Demand& demand, const DriveObjects& objects);
void ip_resume(Demand& demand, const Demand& before, const DriveObjects& objects);
void ip_control(Demand& demand, const DriveObjects& objects, std::int64_t before, std::int64_t now);
void ip_target(Demand& demand, const DriveObjects& objects);
twin::DriveCommand ip(Demand& demand, const DriveObjects& objects, const Feedback& feedback, double dt_s);
int ip_status(const Demand& demand);

}  // namespace tribotwin::hil::cyclic
