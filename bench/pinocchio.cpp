// Pinocchio's own templates, instantiated here by the compiler and flags under test. Nothing of Pinocchio is linked:
// the model comes joint by joint from Pinocchio in Python (pinocchio_cpp.py), so no parser is needed either.
#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

#include <string>

namespace {

namespace pin = pinocchio;
using Vector = Eigen::Map<const Eigen::VectorXd>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

struct Robot {
  pin::Model model;
  pin::Data data;
  pin::FrameIndex tip = 0;
  Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;
};

pin::SE3 pose(const double *rotation, const double *translation) {
  return pin::SE3(Eigen::Map<const RowMajor3>(rotation), Eigen::Map<const Eigen::Vector3d>(translation));
}

// One call of one algorithm for one state; the result stays where Pinocchio leaves it, uncopied.
void inverse_dynamics(Robot &r, const Vector &q, const Vector &v, const Vector &a) { pin::rnea(r.model, r.data, q, v, a); }
void mass_matrix(Robot &r, const Vector &q, const Vector &, const Vector &) {
  pin::crba(r.model, r.data, q, pin::Convention::LOCAL);
}
void forward_dynamics(Robot &r, const Vector &q, const Vector &v, const Vector &tau) {
  pin::aba(r.model, r.data, q, v, tau, pin::Convention::LOCAL);
}
void jacobian(Robot &r, const Vector &q, const Vector &, const Vector &) {
  pin::computeFrameJacobian(r.model, r.data, q, r.tip, pin::LOCAL, r.jacobian);
}
void gravity_forces(Robot &r, const Vector &q, const Vector &, const Vector &) {
  pin::computeGeneralizedGravity(r.model, r.data, q);
}
void inverse_dynamics_derivatives(Robot &r, const Vector &q, const Vector &v, const Vector &a) {
  pin::computeRNEADerivatives(r.model, r.data, q, v, a);
}
void forward_dynamics_derivatives(Robot &r, const Vector &q, const Vector &v, const Vector &tau) {
  pin::computeABADerivatives(r.model, r.data, q, v, tau);
}

template <void (*Algorithm)(Robot &, const Vector &, const Vector &, const Vector &)>
void sweep(Robot &r, long samples, const double *q, const double *v, const double *u) {
  const long nq = r.model.nq, nv = r.model.nv;
  for (long i = 0; i < samples; ++i, q += nq, v += nv, u += nv)
    Algorithm(r, Vector(q, nq), Vector(v, nv), Vector(u, nv));
}

using Sweep = void (*)(Robot &, long, const double *, const double *, const double *);
Sweep find(const std::string &quantity) {
  if (quantity == "inverse_dynamics") return sweep<inverse_dynamics>;
  if (quantity == "mass_matrix") return sweep<mass_matrix>;
  if (quantity == "forward_dynamics") return sweep<forward_dynamics>;
  if (quantity == "jacobian") return sweep<jacobian>;
  if (quantity == "gravity_forces") return sweep<gravity_forces>;
  if (quantity == "inverse_dynamics_derivatives") return sweep<inverse_dynamics_derivatives>;
  if (quantity == "forward_dynamics_derivatives") return sweep<forward_dynamics_derivatives>;
  return nullptr;
}

// Column by column, however Pinocchio keeps it; returns where the next one goes.
template <class Matrix> double *write(const Matrix &values, double *out) {
  Eigen::Map<Eigen::MatrixXd>(out, values.rows(), values.cols()) = values;
  return out + values.size();
}

} // namespace

#pragma GCC visibility push(default)
extern "C" {

Robot *robot_new() { return new Robot; }
void robot_delete(Robot *r) { delete r; }

// Returns 0 for a joint kind that is not handled here. `moment` is about the centre of mass.
int robot_add_joint(Robot *r, const char *kind, long parent, const double *rotation, const double *translation, double mass,
                    const double *com, const double *moment) {
  const std::string name = kind, label = "joint" + std::to_string(r->model.njoints);
  const pin::SE3 placement = pose(rotation, translation);
  pin::JointIndex index = 0;
  if (name == "JointModelRX") index = r->model.addJoint(parent, pin::JointModelRX(), placement, label);
  else if (name == "JointModelRY") index = r->model.addJoint(parent, pin::JointModelRY(), placement, label);
  else if (name == "JointModelRZ") index = r->model.addJoint(parent, pin::JointModelRZ(), placement, label);
  else if (name == "JointModelFreeFlyer") index = r->model.addJoint(parent, pin::JointModelFreeFlyer(), placement, label);
  else return 0;
  const pin::Inertia body(mass, Eigen::Map<const Eigen::Vector3d>(com), Eigen::Map<const RowMajor3>(moment));
  r->model.appendBodyToJoint(index, body, pin::SE3::Identity());
  return 1;
}

// The last call while building: the tip frame, fixed to `parent`.
void robot_finish(Robot *r, long parent, const double *rotation, const double *translation) {
  r->tip = r->model.addFrame(pin::Frame("tip", parent, 0, pose(rotation, translation), pin::OP_FRAME));
  r->data = pin::Data(r->model);
  r->jacobian.setZero(6, r->model.nv);
}

// All samples, `repeats` times, as a user's loop would. Rows of q, v and u are contiguous; u is the acceleration or the torque.
void robot_run(Robot *r, const char *quantity, long repeats, long samples, const double *q, const double *v, const double *u) {
  const Sweep run = find(quantity);
  for (long k = 0; k < repeats; ++k) run(*r, samples, q, v, u);
}

// One sample with its result, column-major, copied out: for the check against Pinocchio in Python.
void robot_evaluate(Robot *r, const char *quantity, const double *q, const double *v, const double *u, double *out) {
  const std::string name = quantity;
  find(name)(*r, 1, q, v, u);
  if (name == "inverse_dynamics") write(r->data.tau, out);
  else if (name == "mass_matrix") write(r->data.M, out);
  else if (name == "forward_dynamics") write(r->data.ddq, out);
  else if (name == "jacobian") write(r->jacobian, out);
  else if (name == "inverse_dynamics_derivatives") write(r->data.dtau_dv, write(r->data.dtau_dq, out));
  else if (name == "forward_dynamics_derivatives")
    write(r->data.Minv, write(r->data.ddq_dv, write(r->data.ddq_dq, out)));
  else write(r->data.g, out);
}

} // extern "C"
#pragma GCC visibility pop
