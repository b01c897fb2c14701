#pragma once

/* Internal to portable/robot: what the C functions of a robot's FMU ask of the twin behind them. Texts that a function
 * leaves say what is wrong; it then returns 0 or NULL. */

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct tribotwin_robot;

struct tribotwin_robot_variable {
  const char *name;
  int kind; /* of the modes' enumeration: 0 result, 1 input */
  double minimum, maximum;
};

/* `resources`: the FMU's folder of that name, as path or file: URI. */
struct tribotwin_robot *tribotwin_robot_open(const char *token, const char *resources, char *text, size_t size);
void tribotwin_robot_close(struct tribotwin_robot *robot);
/* Back to before the first step. */
int tribotwin_robot_reset(struct tribotwin_robot *robot, char *text, size_t size);
int tribotwin_robot_step(struct tribotwin_robot *robot, double dt_s, char *text, size_t size);

/* Of a value reference that is a number and not the time; NULL for others. */
const struct tribotwin_robot_variable *tribotwin_robot_find(const struct tribotwin_robot *robot, unsigned reference);
double *tribotwin_robot_place(struct tribotwin_robot *robot, unsigned reference);
/* The one Boolean: its value reference, and whether a law was left in the last step. */
unsigned tribotwin_robot_boolean(const struct tribotwin_robot *robot);
int tribotwin_robot_outside(const struct tribotwin_robot *robot);

/* Its state as numbers, values of variables included; as many at every time. `numbers` may be NULL. Returns how many,
 * 0 where it cannot be saved. */
size_t tribotwin_robot_save(struct tribotwin_robot *robot, double *numbers, char *text, size_t size);
/* Changes nothing where it fails. */
int tribotwin_robot_restore(struct tribotwin_robot *robot, const double *numbers, size_t count, char *text,
                            size_t size);

#ifdef __cplusplus
}
#endif
