// A URDF with UUV Simulator's plugins in a world of ODE: links and hinges from the file, the plugins' own code, steps as Gazebo Classic
// makes them (quick step, 50 iterations).
//
//   world URDF GRAVITY STEP SAMPLE COMMANDS RESULT
//
// COMMANDS: number of samples; x y z roll pitch yaw, then velocity and turn rate of the base link's origin in its axes, forward, port, up; the current in
// world axes; then for each sample the inputs of the thrusters in the order of their numbers. RESULT: pose and velocities at each sample.
#include "shim.hh"

#include <cstdlib>
#include <fstream>
#include <new>
#include <stdexcept>

// HydrodynamicModel leaves the time of its last call unset, and works where memory is zero: here it always is.
void *operator new(std::size_t _size)
{
  if (void *found = std::calloc(1, _size)) return found;
  throw std::bad_alloc();
}
void operator delete(void *_memory) noexcept { std::free(_memory); }
void operator delete(void *_memory, std::size_t) noexcept { std::free(_memory); }

using namespace gazebo;

static const double WARM_UP = 10.0;
typedef boost::shared_ptr<const uuv_gazebo_plugins_msgs::msgs::Double> Input;

static Vector3d VectorOf(const tinyxml2::XMLElement *_element, const char *_key)
{
  Vector3d found;
  std::istringstream(_element->Attribute(_key)) >> found;
  return found;
}

static physics::LinkPtr AddLink(dWorldID _world, const tinyxml2::XMLElement *_link, physics::Model *_model)
{
  const auto inertial = _link->FirstChildElement("inertial");
  const auto inertia = inertial->FirstChildElement("inertia");
  const double mass = inertial->FirstChildElement("mass")->DoubleAttribute("value");
  physics::LinkPtr link(new physics::Link());
  link->name = _link->Attribute("name");
  link->model = _model;
  link->inertial.reset(new physics::Inertial{mass, VectorOf(inertial->FirstChildElement("origin"), "xyz")});
  link->body = dBodyCreate(_world);
  dBodySetAutoDisableFlag(link->body, 0);
  dMass moments;
  dMassSetParameters(&moments, mass, 0, 0, 0, inertia->DoubleAttribute("ixx"), inertia->DoubleAttribute("iyy"),
                     inertia->DoubleAttribute("izz"), inertia->DoubleAttribute("ixy"), inertia->DoubleAttribute("ixz"),
                     inertia->DoubleAttribute("iyz"));
  dBodySetMass(link->body, &moments);
  return link;
}

static void Place(physics::Link &_link, const Pose3d &_pose, const Vector3d &_linear, const Vector3d &_angular)
{
  const Vector3d at = _pose.Pos() + _pose.Rot().RotateVector(_link.inertial->cog);
  const dQuaternion q = {_pose.Rot().W(), _pose.Rot().X(), _pose.Rot().Y(), _pose.Rot().Z()};
  dBodySetPosition(_link.body, at.X(), at.Y(), at.Z());
  dBodySetQuaternion(_link.body, q);
  _link.SetVel(_linear, _angular);
}

static void Call(double _time)
{
  common::UpdateInfo info;
  info.simTime.value = _time;
  for (auto &update : event::Updates()) update(info);
}

static void Send(const std::string &_model, const std::vector<double> &_inputs)
{
  for (std::size_t i = 0; i < _inputs.size(); ++i)
    transport::Handlers<uuv_gazebo_plugins_msgs::msgs::Double>().at(
      "/" + _model + "/thrusters/" + std::to_string(i) + "/input")(
      Input(new uuv_gazebo_plugins_msgs::msgs::Double{_inputs[i]}));
}

int main(int, char **_arguments)
{
  const double gravity = std::atof(_arguments[2]), step = std::atof(_arguments[3]), sample = std::atof(_arguments[4]);
  std::ifstream commands(_arguments[5]);
  std::ofstream result(_arguments[6]);
  result.precision(17);
  std::cout.setstate(std::ios::failbit);
  std::clog.setstate(std::ios::failbit);
  tinyxml2::XMLDocument file;
  if (file.LoadFile(_arguments[1]) != tinyxml2::XML_SUCCESS) throw std::runtime_error("no URDF");
  const auto robot = file.FirstChildElement("robot");

  dInitODE();
  dWorldID world = dWorldCreate();
  dWorldSetGravity(world, 0, 0, -gravity);
  dWorldSetQuickStepNumIterations(world, 50);
  physics::ModelPtr model(new physics::Model());
  model->name = robot->Attribute("name");
  model->world.reset(new physics::World{Vector3d(0, 0, -gravity)});
  physics::LinkPtr base;
  for (auto link = robot->FirstChildElement("link"); link; link = link->NextSiblingElement("link"))
  {
    auto found = AddLink(world, link, model.get());
    model->links[found->name] = found;
    if (!base) base = found;
  }

  Vector3d place, turn, linear, angular, current;
  int samples;
  commands >> samples >> place >> turn >> linear >> angular >> current;
  const Pose3d pose(place, Quaterniond(turn));
  const Vector3d moving = pose.Rot().RotateVector(linear), turning = pose.Rot().RotateVector(angular);
  Place(*base, pose, moving, turning);
  for (auto one = robot->FirstChildElement("joint"); one; one = one->NextSiblingElement("joint"))
  {
    physics::JointPtr joint(new physics::Joint());
    joint->parent = model->GetLink(one->FirstChildElement("parent")->Attribute("link"));
    joint->child = model->GetLink(one->FirstChildElement("child")->Attribute("link"));
    const Vector3d arm = pose.Rot().RotateVector(VectorOf(one->FirstChildElement("origin"), "xyz"));
    Place(*joint->child, Pose3d(place + arm, pose.Rot()), moving + turning.Cross(arm), turning);
    const Vector3d axis = pose.Rot().RotateVector(VectorOf(one->FirstChildElement("axis"), "xyz"));
    joint->id = dJointCreateHinge(world, 0);
    dJointAttach(joint->id, joint->child->body, joint->parent->body);
    dJointSetHingeAnchor(joint->id, place.X() + arm.X(), place.Y() + arm.Y(), place.Z() + arm.Z());
    dJointSetHingeAxis(joint->id, axis.X(), axis.Y(), axis.Z());
    model->joints[one->Attribute("name")] = joint;
  }

  std::vector<std::unique_ptr<ModelPlugin>> plugins;
  const auto group = robot->FirstChildElement("gazebo");
  for (auto one = group->FirstChildElement("plugin"); one; one = one->NextSiblingElement("plugin"))
  {
    const bool thruster = std::string(one->Attribute("filename")).find("thruster") != std::string::npos;
    plugins.emplace_back(Plugins().at(thruster ? "gazebo::ThrusterPlugin" : "UnderwaterObjectPlugin")());
    plugins.back()->Load(model, std::make_shared<sdf::Element>(one));
  }
  const std::size_t count = model->joints.size();
  auto flow = transport::Handlers<msgs::Vector3d>().at("hydrodynamics/current_velocity");
  boost::shared_ptr<msgs::Vector3d> water(new msgs::Vector3d());
  msgs::Set(water.get(), current);
  flow(water);

  // Filters and lags settle at the state of the start, while nothing moves on.
  double time = 0;
  std::vector<double> inputs(count);
  for (int row = 0; row <= samples; ++row)
  {
    const Pose3d at = base->WorldPose();
    const Vector3d u = base->RelativeLinearVel(), w = base->RelativeAngularVel();
    result << at.Pos() << " " << at.Rot().Euler() << " " << u << " " << w << "\n";
    if (row == samples) return 0;
    for (auto &input : inputs) commands >> input;
    Send(model->name, inputs);
    if (row == 0)
    {
      std::map<dBodyID, std::pair<Vector3d, Vector3d>> kept;
      for (auto &link : model->links)
        kept[link.second->body] = {link.second->WorldLinearVel(), link.second->WorldAngularVel()};
      for (long i = 0; i < std::lround(WARM_UP / step); ++i)
      {
        for (auto &link : model->links)
        {
          auto &own = kept[link.second->body];
          link.second->SetVel(own.first, own.second);
        }
        Call(time += step);
        for (auto &link : model->links)
        {
          dBodySetForce(link.second->body, 0, 0, 0);
          dBodySetTorque(link.second->body, 0, 0, 0);
        }
      }
    }
    for (long i = 0; i < std::lround(sample / step); ++i)
    {
      Call(time += step);
      dWorldQuickStep(world, step);
    }
  }
}
