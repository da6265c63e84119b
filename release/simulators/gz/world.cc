// A world of SDFormat with gz-sim's own systems on DART: inertia, added mass, gravity, joints and steps as gz-physics sets them up.
//
//   world SDF SAMPLE COMMANDS RESULT
//
// COMMANDS: number of samples; x y z roll pitch yaw, then velocity and turn rate of the base link's origin in its axes, forward, port, up;
// the current in world axes; then for each sample the commands of the thrusters and of the fins in the order of the file. RESULT: pose and
// velocities at each sample. Buoyancy acts at the centre of the link's box, and fins go where they are told within a step, as gz-sim's
// Buoyancy and JointPositionController (use_velocity_commands) do.
#include <dart/dynamics/BodyNode.hpp>
#include <dart/dynamics/FreeJoint.hpp>
#include <dart/dynamics/RevoluteJoint.hpp>
#include <dart/dynamics/Skeleton.hpp>
#include <dart/simulation/World.hpp>
#include <fstream>

#include "shim.hh"

using namespace gz;
using namespace sim;
using dart::dynamics::BodyNode;

static const double FIN_SPEED = 1000.0;

static const tinyxml2::XMLElement *At(const tinyxml2::XMLElement *_element, std::initializer_list<const char *> _path)
{
  for (auto name : _path)
    if (!(_element = _element->FirstChildElement(name))) throw std::runtime_error(std::string("no ") + name);
  return _element;
}

template <typename T> static T Read(const tinyxml2::XMLElement *_element)
{
  T found{};
  std::istringstream(_element->GetText()) >> found;
  return found;
}

static math::Vector3d PlaceOf(const tinyxml2::XMLElement *_element)
{
  const auto pose = _element->FirstChildElement("pose");
  return pose ? Read<math::Pose3d>(pose).Pos() : math::Vector3d::Zero;
}

static Eigen::Vector3d ToEigen(const math::Vector3d &_v) { return {_v.X(), _v.Y(), _v.Z()}; }
static math::Vector3d FromEigen(const Eigen::Vector3d &_v) { return {_v.x(), _v.y(), _v.z()}; }

static Eigen::Matrix<double, 6, 6> AddedMass(const tinyxml2::XMLElement *_inertial)
{
  Eigen::Matrix<double, 6, 6> found = Eigen::Matrix<double, 6, 6>::Zero();
  const std::string axes = "xyzpqr";
  for (auto one = At(_inertial, {"fluid_added_mass"})->FirstChildElement(); one; one = one->NextSiblingElement())
  {
    const auto i = axes.find(one->Name()[0]), j = axes.find(one->Name()[1]);
    found(i, j) = found(j, i) = Read<double>(one);
  }
  return found;
}

static dart::dynamics::Inertia InertiaOf(const tinyxml2::XMLElement *_inertial)
{
  auto get = [&](const char *_key) { return Read<double>(At(_inertial, {"inertia", _key})); };
  dart::dynamics::Inertia found;
  found.setMass(Read<double>(At(_inertial, {"mass"})));
  found.setMoment(get("ixx"), get("iyy"), get("izz"), get("ixy"), get("ixz"), get("iyz"));
  found.setLocalCOM(ToEigen(PlaceOf(_inertial)));
  return found;
}

struct Part
{
  Entity link, joint;
  BodyNode *body;
  dart::dynamics::RevoluteJoint *hinge;
};

static math::Pose3d PoseOf(const BodyNode *_body)
{
  const auto &found = _body->getWorldTransform();
  const Eigen::Quaterniond q(found.linear());
  return {FromEigen(found.translation()), math::Quaterniond(q.w(), q.x(), q.y(), q.z())};
}

static void Observe(EntityComponentManager &_ecm, Entity _link, const BodyNode *_body)
{
  _ecm.SetComponentData<components::WorldPose>(_link, PoseOf(_body));
  _ecm.SetComponentData<components::WorldLinearVelocity>(_link, FromEigen(_body->getLinearVelocity()));
  _ecm.SetComponentData<components::WorldAngularVelocity>(_link, FromEigen(_body->getAngularVelocity()));
}

int main(int, char **_arguments)
{
  const double sample = std::atof(_arguments[2]);
  std::ifstream commands(_arguments[3]);
  std::ofstream result(_arguments[4]);
  result.precision(17);
  std::clog.setstate(std::ios::failbit);
  tinyxml2::XMLDocument file;
  if (file.LoadFile(_arguments[1]) != tinyxml2::XML_SUCCESS) throw std::runtime_error("no SDFormat");
  const auto water = At(&file.RootElement()[0], {"world"});
  const auto model = At(water, {"model"}), base = At(model, {"link"});
  const double step = Read<double>(At(water, {"physics", "max_step_size"}));
  const math::Vector3d gravity = Read<math::Vector3d>(At(water, {"gravity"}));
  double density = 0;
  for (auto one = water->FirstChildElement("plugin"); one; one = one->NextSiblingElement("plugin"))
    if (one->FirstChildElement("uniform_fluid_density")) density = Read<double>(At(one, {"uniform_fluid_density"}));

  auto world = dart::simulation::World::create();
  world->setGravity(ToEigen(gravity));
  world->setTimeStep(step);
  auto skeleton = dart::dynamics::Skeleton::create();
  auto [free, hull] = skeleton->createJointAndBodyNodePair<dart::dynamics::FreeJoint>();
  const auto inertial = At(base, {"inertial"});
  auto inertia = InertiaOf(inertial);
  const double mass = inertia.getMass();
  const Eigen::Vector3d centre = inertia.getLocalCOM();
  const auto added = AddedMass(inertial);
  Eigen::Matrix<double, 6, 6> turned;  // DART has rotation first
  turned << added.block<3, 3>(3, 3), added.block<3, 3>(3, 0), added.block<3, 3>(0, 3), added.block<3, 3>(0, 0);
  inertia.setSpatialTensor(inertia.getSpatialTensor() + turned);
  hull->setInertia(inertia);
  hull->setGravityMode(false);  // as gz-physics: weight is a force at the centre of gravity

  EntityComponentManager ecm;
  EventManager events;
  ecm.model = model->Attribute("name");
  const Entity entity = ecm.CreateEntity(), link = ecm.CreateEntity();
  ecm.links["base_link"] = link;
  ecm.addedMass[link] = added;
  std::map<std::string, Part> parts;
  for (auto one = base->NextSiblingElement("link"); one; one = one->NextSiblingElement("link"))
  {
    const tinyxml2::XMLElement *joint = model->FirstChildElement("joint");
    while (std::string(Read<std::string>(At(joint, {"child"}))) != one->Attribute("name"))
      joint = joint->NextSiblingElement("joint");
    const math::Vector3d axis = Read<math::Vector3d>(At(joint, {"axis", "xyz"}));
    auto [hinge, body] = hull->createChildJointAndBodyNodePair<dart::dynamics::RevoluteJoint>();
    Eigen::Isometry3d place = Eigen::Isometry3d::Identity();
    place.translation() = ToEigen(PlaceOf(one));
    hinge->setTransformFromParentBodyNode(place);
    hinge->setAxis(ToEigen(axis));
    hinge->setActuatorType(dart::dynamics::Joint::SERVO);
    body->setInertia(InertiaOf(At(one, {"inertial"})));
    Part part{ecm.CreateEntity(), ecm.CreateEntity(), body, hinge};
    ecm.links[one->Attribute("name")] = part.link;
    ecm.joints[joint->Attribute("name")] = part.joint;
    ecm.CreateComponent(part.joint, components::JointAxis(sdf::JointAxis{axis}));
    ecm.CreateComponent(part.joint, components::Pose());
    ecm.CreateComponent(part.joint, components::ChildLinkName(one->Attribute("name")));
    parts[joint->Attribute("name")] = part;
  }
  world->addSkeleton(skeleton);

  math::Vector3d place, turn, linear, angular;
  msgs::Vector3d current;
  int samples;
  commands >> samples >> place >> turn >> linear >> angular >> current.value;
  const math::Quaterniond rotation(turn);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = ToEigen(place);
  pose.linear() = Eigen::Quaterniond(rotation.W(), rotation.X(), rotation.Y(), rotation.Z()).toRotationMatrix();
  free->setTransform(pose);
  Eigen::Vector6d motion;
  motion << ToEigen(angular), ToEigen(linear);
  free->setSpatialVelocity(motion, dart::dynamics::Frame::World(), hull);

  auto observe = [&]
  {
    Observe(ecm, link, hull);
    for (auto &one : parts)
    {
      Observe(ecm, one.second.link, one.second.body);
      ecm.SetComponentData<components::JointPosition>(one.second.joint, std::vector<double>{one.second.hinge->getPosition(0)});
    }
  };
  observe();
  std::vector<std::unique_ptr<System>> systems;
  std::vector<std::string> topics, fins;
  for (auto one = model->FirstChildElement("plugin"); one; one = one->NextSiblingElement("plugin"))
  {
    const std::string name = std::string(one->Attribute("name")).substr(std::string("gz::sim::systems::").size());
    if (name == "JointPositionController")
    {
      fins.push_back(Read<std::string>(At(one, {"joint_name"})));
      continue;
    }
    if (name == "Thruster")
    {
      const bool speed = Read<std::string>(At(one, {"use_angvel_cmd"})) == "true";
      topics.push_back("/model/" + Read<std::string>(At(one, {"namespace"})) + "/joint/" +
                       Read<std::string>(At(one, {"joint_name"})) + (speed ? "/cmd_vel" : "/cmd_thrust"));
    }
    systems.emplace_back(Systems().at(name)());
    dynamic_cast<ISystemConfigure &>(*systems.back()).Configure(entity, std::make_shared<sdf::Element>(one), ecm, events);
  }
  transport::Handlers<msgs::Vector3d>().at("/ocean_current")(current);

  const auto box = At(base, {"collision"});
  const math::Vector3d size = Read<math::Vector3d>(At(box, {"geometry", "box", "size"})), middle = PlaceOf(box);
  const math::Vector3d lift = -density * size.X() * size.Y() * size.Z() * gravity;
  UpdateInfo info;
  info.dt = std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(step));
  std::map<std::string, double> angles;
  for (int row = 0; row <= samples; ++row)
  {
    const math::Pose3d at = PoseOf(hull);
    const math::Vector3d u = at.Rot().RotateVectorReverse(FromEigen(hull->getLinearVelocity()));
    const math::Vector3d w = at.Rot().RotateVectorReverse(FromEigen(hull->getAngularVelocity()));
    result << at.Pos() << " " << at.Rot().Euler() << " " << u << " " << w << "\n";
    if (row == samples) return 0;
    msgs::Double command;
    for (auto &topic : topics)
    {
      commands >> command.value;
      transport::Handlers<msgs::Double>().at(topic)(command);
    }
    for (auto &fin : fins) commands >> angles[fin];
    for (long i = 0; i < std::lround(sample / step); ++i)
    {
      observe();
      ecm.wrenches.clear();
      for (auto &system : systems) dynamic_cast<ISystemPreUpdate &>(*system).PreUpdate(info, ecm);
      const math::Quaterniond now = PoseOf(hull).Rot();
      Link(link).AddWorldWrench(ecm, lift, now.RotateVector(middle).Cross(lift));
      for (auto &fin : fins)
      {
        const double missing = (angles[fin] - parts.at(fin).hinge->getPosition(0)) / step;
        ecm.SetComponentData<components::JointVelocityCmd>(
          parts.at(fin).joint, std::vector<double>{math::clamp(missing, -FIN_SPEED, FIN_SPEED)});
      }
      hull->addExtForce(mass * ToEigen(gravity), centre, false, true);
      auto push = [&](Entity _link, BodyNode *_body)
      {
        const auto wrench = ecm.wrenches.find(_link);
        if (wrench == ecm.wrenches.end()) return;
        _body->addExtForce(ToEigen(wrench->second.first), Eigen::Vector3d::Zero(), false, true);
        _body->addExtTorque(ToEigen(wrench->second.second), false);
      };
      push(link, hull);
      for (auto &one : parts)
      {
        push(one.second.link, one.second.body);
        one.second.hinge->setCommand(0, ecm.Component<components::JointVelocityCmd>(one.second.joint)->Data()[0]);
      }
      world->step();
      info.simTime += info.dt;
    }
  }
}
