// Plays arm.csv of `dexgrasp export` by libfranka at 1 kHz, one row a cycle.
#include <franka/robot.h>

// rows: arm.csv without its first column
void play(franka::Robot& robot, const std::vector<std::array<double, 7>>& rows) {
  const auto start = robot.readOnce().q_d;
  for (size_t j = 0; j < 7; ++j)
    if (std::abs(start[j] - rows[0][j]) > 0.01) throw std::runtime_error("not at the first row: go there first");
  size_t k = 0;
  robot.control([&](const franka::RobotState&, franka::Duration period) -> franka::JointPositions {
    k = std::min(k + period.toMSec(), rows.size() - 1);  // a lost packet is a step of 2
    const double rest = k < 1000 ? 0.5 + 0.5 * std::cos(M_PI * k / 1000.0) : 0.0;
    franka::JointPositions next(rows[k]);
    for (size_t j = 0; j < 7; ++j) next.q[j] += rest * (start[j] - rows[0][j]);  // what is missed fades in a second
    return k + 1 == rows.size() ? franka::MotionFinished(next) : next;
  });
}
