// Prints visp_numbers.json: interaction matrices as ViSP computes them (made with 3.5.0).
//
//   g++ visp_numbers.cpp -lvisp_visual_features -lvisp_core && ./a.out > visp_numbers.json
//
// Debian's libvisp-visual-features-dev has what it needs.

#include <cstdio>

#include <visp3/core/vpThetaUVector.h>
#include <visp3/visual_features/vpFeatureDepth.h>
#include <visp3/visual_features/vpFeaturePoint.h>
#include <visp3/visual_features/vpFeatureThetaU.h>

static void print(const char *name, const vpMatrix &matrix, unsigned first_column, const char *end) {
  std::printf("\"%s\": [", name);
  for (unsigned i = 0; i < matrix.getRows(); ++i) {
    std::printf(i ? ", [" : "[");
    for (unsigned j = first_column; j < matrix.getCols(); ++j)
      std::printf(j > first_column ? ", %.17g" : "%.17g", matrix[i][j]);
    std::printf("]");
  }
  std::printf("]%s", end);
}

static void print_point(double X, double Y, double Z, const char *end) {
  vpFeaturePoint point;
  point.buildFrom(X / Z, Y / Z, Z);
  vpFeatureDepth depth;  // log(Z / Z*), its goal being the depth itself
  depth.buildFrom(X / Z, Y / Z, Z, 0.0);
  std::printf("  {\"t_cam_obj\": [%.17g, %.17g, %.17g],\n   ", X, Y, Z);
  print("xy", point.interaction(), 0, ",\n   ");
  print("log_Z", depth.interaction(), 0, end);
}

static void print_turn(double x, double y, double z, const char *end) {
  vpThetaUVector theta_u(x, y, z);
  vpFeatureThetaU current_in_goal(vpFeatureThetaU::cdRc), goal_in_current(vpFeatureThetaU::cRcd);
  current_in_goal.buildFrom(theta_u);
  goal_in_current.buildFrom(theta_u);
  std::printf("  {\"theta_u\": [%.17g, %.17g, %.17g],\n   ", x, y, z);
  print("goal_R_cam", current_in_goal.interaction(), 3, ",\n   ");
  print("cam_R_goal", goal_in_current.interaction(), 3, end);
}

int main() {
  std::printf("{\n \"points\": [\n");
  print_point(0.2, 0.4, 2.0, "},\n");
  print_point(-0.35, 0.12, 0.7, "},\n");
  print_point(0.5, -0.9, 1.3, "}\n");
  std::printf(" ],\n \"turns\": [\n");
  print_turn(0.3, -0.2, 0.5, "},\n");
  print_turn(-1.1, 0.4, 0.9, "},\n");
  print_turn(1e-7, 2e-7, -1e-7, "},\n");
  print_turn(2.0, -1.5, 1.0, "}\n");
  std::printf(" ]\n}\n");
}
