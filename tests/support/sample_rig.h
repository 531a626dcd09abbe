#pragma once

#include "geometry/angles.h"
#include "rig/rig.h"

namespace wagonsight::test {

// Two small Kinects and a rectified stereo camera; small images, so that every byte can be tried.
inline Rig sample_rig(int width = 8, int height = 6) {
  Rig rig;
  for (const char* name : {"k0", "k1", "s0"}) {
    RigSensor sensor;
    sensor.name = name;
    sensor.camera.width = width;
    sensor.camera.height = height;
    sensor.camera.fx = sensor.camera.fy = 0.9 * width;
    sensor.camera.cx = width / 2.0 - 0.5;
    sensor.camera.cy = height / 2.0 - 0.5;
    sensor.camera.distortion = {0.12, -0.2, 0.001, -0.002, 0.05};
    sensor.X_BS = {from_omega_phi_kappa({0.1, -0.2, 0.3}), {0.5, -0.25, 1.5}};
    sensor.X_WS = {look_at({1, 0.2, 2.3}, {3, 1.3, 0}), {1, 0.2, 2.3}};
    sensor.covariance.diagonal().setConstant(1e-6);
    sensor.rms_px = 0.31;
    rig.sensors.push_back(sensor);
  }
  rig.sensors[1].has_pose = false;
  rig.sensors[1].trim_far = 4.5;
  rig.sensors[1].depth_scale = 1.012;
  rig.sensors[1].depth_offset = -0.004;
  rig.sensors[2].kind = SensorKind::kStereo;
  rig.sensors[2].stereo.baseline = 0.12;
  rig.sensors[2].stereo.left = rig.sensors[2].stereo.right = rig.sensors[2].camera;
  rig.sensors[2].stereo.right.cx += 3;
  rig.sensors[2].stereo.X_LR = {from_omega_phi_kappa({0.01, -0.02, 0.005}), {0.12, 0.001, 0}};
  rig.sensors[2].camera.distortion = {};
  rig.georeference.present = true;
  rig.georeference.X_WB = {1.0004, from_omega_phi_kappa({0.2, 0.1, -2.0}), {2.5, 1.3, 0.8}};
  rig.georeference.covariance.diagonal().setConstant(4e-6);
  rig.georeference.rms_m = 0.006;
  rig.provenance.made_by = "rig_test 1.0";
  rig.provenance.created_unix = 1'700'000'000;
  rig.provenance.note = "made for a test";
  return rig;
}

}  // namespace wagonsight::test
