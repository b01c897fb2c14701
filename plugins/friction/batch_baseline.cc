#define TRIBOTWIN_KERNEL torque_baseline
#include "batch_kernel.inc"
