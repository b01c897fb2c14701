#define MOMENTS moments_baseline
#define RESIDUALS residuals_baseline
#include "moments_kernel.inc"
