// The part of Gazebo Classic's API that UUV Simulator's plugins use, on ODE: each call does what Gazebo 9 to 11 do in
// gazebo/physics/ode/ODELink.cc and ODEHingeJoint.cc, and nothing is published. Stands for all headers of Gazebo, SDFormat and the
// plugins' messages.
#pragma once

#include <ode/ode.h>
#include <tinyxml2.h>

#include <boost/algorithm/string.hpp>
#include <boost/bind.hpp>
#include <boost/shared_ptr.hpp>
#include <cmath>
#include <functional>
#include <ignition/math/AxisAlignedBox.hh>
#include <ignition/math/Matrix3.hh>
#include <ignition/math/Pose3.hh>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#define GAZEBO_MAJOR_VERSION 9
#define GZ_ASSERT(condition, message)                                                                                  \
  do                                                                                                                   \
    if (!(condition)) throw std::runtime_error(message);                                                               \
  while (0)
#define gzmsg std::clog
#define gzwarn std::cerr
#define gzerr std::cerr

namespace ignition
{
namespace math
{
typedef AxisAlignedBox Box;  // its name in Ignition Math 4
}
}
using ignition::math::Pose3d;
using ignition::math::Quaterniond;
using ignition::math::Vector3d;

namespace sdf
{
class Element;
typedef std::shared_ptr<Element> ElementPtr;

class Element
{
public:
  explicit Element(const tinyxml2::XMLElement *_xml) : xml(_xml) {}
  bool HasElement(const std::string &_name) const { return this->xml->FirstChildElement(_name.c_str()); }
  bool HasAttribute(const std::string &_name) const { return this->xml->Attribute(_name.c_str()); }
  ElementPtr GetElement(const std::string &_name) const { return Of(this->xml->FirstChildElement(_name.c_str())); }
  ElementPtr GetNextElement(const std::string &_name) const { return Of(this->xml->NextSiblingElement(_name.c_str())); }
  template <typename T> T Get(const std::string &_name) const
  {
    const char *found = this->xml->Attribute(_name.c_str());
    if (!found && this->HasElement(_name)) found = this->xml->FirstChildElement(_name.c_str())->GetText();
    T value{};
    if (found) Read(found, value);
    return value;
  }

private:
  static ElementPtr Of(const tinyxml2::XMLElement *_xml) { return _xml ? std::make_shared<Element>(_xml) : nullptr; }
  static void Read(const char *_text, std::string &_value) { _value = _text; }
  template <typename T> static void Read(const char *_text, T &_value) { std::istringstream(_text) >> _value; }
  const tinyxml2::XMLElement *xml;
};
}

namespace gazebo
{
namespace common
{
struct Time
{
  double value = 0;
  int sec = 0, nsec = 0;
  double Double() const { return this->value; }
};
struct UpdateInfo
{
  Time simTime;
};
}

namespace physics
{
struct Inertial
{
  double mass;
  Vector3d cog;
  double Mass() const { return this->mass; }
  const Vector3d &CoG() const { return this->cog; }
};

struct Model;
typedef boost::shared_ptr<Model> ModelPtr;

// A link is an ODE body whose position is the centre of gravity, with the link's orientation.
struct Link
{
  std::string name;
  dBodyID body;
  std::shared_ptr<Inertial> inertial;
  Model *model;

  std::string GetName() const { return this->name; }
  Model *GetModel() const { return this->model; }
  std::shared_ptr<Inertial> GetInertial() const { return this->inertial; }
  ignition::math::Box BoundingBox() const { return ignition::math::Box(Vector3d::Zero, Vector3d::Zero); }
  Quaterniond Rot() const
  {
    const dReal *q = dBodyGetQuaternion(this->body);
    return Quaterniond(q[0], q[1], q[2], q[3]);
  }
  Pose3d WorldPose() const
  {
    const dReal *p = dBodyGetPosition(this->body);
    return Pose3d(Vector3d(p[0], p[1], p[2]) - this->Rot().RotateVector(this->inertial->cog), this->Rot());
  }
  Vector3d WorldLinearVel() const
  {
    dVector3 found;
    const Vector3d offset = -this->inertial->cog;
    dBodyGetRelPointVel(this->body, offset.X(), offset.Y(), offset.Z(), found);
    return Vector3d(found[0], found[1], found[2]);
  }
  Vector3d WorldAngularVel() const
  {
    const dReal *w = dBodyGetAngularVel(this->body);
    return Vector3d(w[0], w[1], w[2]);
  }
  Vector3d RelativeLinearVel() const { return this->Rot().RotateVectorReverse(this->WorldLinearVel()); }
  Vector3d RelativeAngularVel() const { return this->Rot().RotateVectorReverse(this->WorldAngularVel()); }
  Vector3d RelativeLinearAccel() const
  {
    const dReal *f = dBodyGetForce(this->body);
    return this->Rot().RotateVectorReverse(Vector3d(f[0], f[1], f[2])) / this->inertial->mass;
  }
  Vector3d RelativeAngularAccel() const
  {
    const dReal *t = dBodyGetTorque(this->body);
    return this->Rot().RotateVectorReverse(Vector3d(t[0], t[1], t[2]));
  }
  void SetVel(const Vector3d &_linear, const Vector3d &_angular)
  {
    const Vector3d centre = _linear + _angular.Cross(this->Rot().RotateVector(this->inertial->cog));
    dBodySetLinearVel(this->body, centre.X(), centre.Y(), centre.Z());
    dBodySetAngularVel(this->body, _angular.X(), _angular.Y(), _angular.Z());
  }
  void AddForce(const Vector3d &_f) { dBodyAddForce(this->body, _f.X(), _f.Y(), _f.Z()); }
  void AddRelativeForce(const Vector3d &_f) { dBodyAddRelForce(this->body, _f.X(), _f.Y(), _f.Z()); }
  void AddRelativeTorque(const Vector3d &_t) { dBodyAddRelTorque(this->body, _t.X(), _t.Y(), _t.Z()); }
  // A force in world axes at a position from the centre of gravity in the link's axes.
  void AddForceAtRelativePosition(const Vector3d &_f, const Vector3d &_at)
  {
    dBodyAddForceAtRelPos(this->body, _f.X(), _f.Y(), _f.Z(), _at.X(), _at.Y(), _at.Z());
  }
};
typedef boost::shared_ptr<Link> LinkPtr;

// A hinge; its velocity is set as Joint::SetVelocityMaximal does, on the child.
struct Joint
{
  LinkPtr parent, child;
  dJointID id;
  Pose3d WorldPose() const { return this->child->WorldPose(); }
  Vector3d GlobalAxis(unsigned int) const
  {
    dVector3 a;
    dJointGetHingeAxis(this->id, a);
    return Vector3d(a[0], a[1], a[2]);
  }
  bool SetVelocity(unsigned int, double _speed)
  {
    const Vector3d turn = this->parent->WorldAngularVel();
    const Vector3d arm = this->child->WorldPose().Pos() - this->parent->WorldPose().Pos();
    this->child->SetVel(this->parent->WorldLinearVel() + turn.Cross(arm), turn + _speed * this->GlobalAxis(0));
    return true;
  }
};
typedef boost::shared_ptr<Joint> JointPtr;

struct World
{
  Vector3d gravity;
  std::string Name() const { return "water"; }
  Vector3d Gravity() const { return this->gravity; }
  common::Time SimTime() const { return common::Time(); }
};
typedef boost::shared_ptr<World> WorldPtr;

struct Model
{
  std::string name;
  WorldPtr world;
  std::map<std::string, LinkPtr> links;
  std::map<std::string, JointPtr> joints;
  std::string GetName() const { return this->name; }
  WorldPtr GetWorld() const { return this->world; }
  LinkPtr GetLink(const std::string &_name) const { return this->links.count(_name) ? this->links.at(_name) : nullptr; }
  JointPtr GetJoint(const std::string &_name) const
  {
    return this->joints.count(_name) ? this->joints.at(_name) : nullptr;
  }
};
}

namespace event
{
struct Connection
{
};
typedef boost::shared_ptr<Connection> ConnectionPtr;
typedef std::function<void(const common::UpdateInfo &)> Update;
inline std::vector<Update> &Updates()
{
  static std::vector<Update> updates;
  return updates;
}
struct Events
{
  static ConnectionPtr ConnectWorldUpdateBegin(const Update &_update)
  {
    Updates().push_back(_update);
    return ConnectionPtr(new Connection());
  }
};
}

namespace msgs
{
struct Vector3d
{
  double values[3] = {0, 0, 0};
  double x() const { return this->values[0]; }
  double y() const { return this->values[1]; }
  double z() const { return this->values[2]; }
};
struct Time
{
  void set_sec(int) {}
  void set_nsec(int) {}
};
struct Wrench
{
  Vector3d force, torque;
  Vector3d *mutable_force() { return &this->force; }
  Vector3d *mutable_torque() { return &this->torque; }
};
struct WrenchStamped
{
  Wrench wrench;
  Time time;
  Wrench *mutable_wrench() { return &this->wrench; }
  Time *mutable_time() { return &this->time; }
};
inline void Set(Vector3d *_message, const ignition::math::Vector3d &_v)
{
  for (int i = 0; i < 3; ++i) _message->values[i] = _v[i];
}
}
typedef const boost::shared_ptr<const msgs::Vector3d> ConstVector3dPtr;

namespace transport
{
// Messages to a plugin go through the handler of their topic.
template <typename M> std::map<std::string, std::function<void(const boost::shared_ptr<const M> &)>> &Handlers()
{
  static std::map<std::string, std::function<void(const boost::shared_ptr<const M> &)>> handlers;
  return handlers;
}
struct Subscriber
{
};
struct Publisher
{
  template <typename M> void Publish(const M &) {}
};
typedef boost::shared_ptr<Subscriber> SubscriberPtr;
typedef boost::shared_ptr<Publisher> PublisherPtr;
struct Node
{
  void Init(const std::string &) {}
  template <typename M> PublisherPtr Advertise(const std::string &) { return PublisherPtr(new Publisher()); }
  template <typename M, typename T>
  SubscriberPtr Subscribe(const std::string &_topic, void (T::*_handler)(const boost::shared_ptr<const M> &), T *_self)
  {
    Handlers<M>()[_topic] = [=](const boost::shared_ptr<const M> &_message) { (_self->*_handler)(_message); };
    return SubscriberPtr(new Subscriber());
  }
};
typedef boost::shared_ptr<Node> NodePtr;
}

struct ModelPlugin
{
  virtual ~ModelPlugin() {}
  virtual void Load(physics::ModelPtr, sdf::ElementPtr) = 0;
  virtual void Init() {}
  virtual void Reset() {}
};
inline std::map<std::string, std::function<ModelPlugin *()>> &Plugins()
{
  static std::map<std::string, std::function<ModelPlugin *()>> plugins;
  return plugins;
}
}
#define GZ_REGISTER_MODEL_PLUGIN(type)                                                                                 \
  static const bool registeredPlugin = gazebo::Plugins().emplace(#type, [] { return new type(); }).second;

namespace uuv_gazebo_plugins_msgs
{
namespace msgs
{
struct Double
{
  double number;
  double value() const { return this->number; }
};
}
}
