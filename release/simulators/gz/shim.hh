// The part of gz-sim's API that its hydrodynamics, lift-drag and thruster systems use: components in a map, messages through handlers.
// There is no environment, wind or battery. Forces add up at the link's origin, as gz-sim's Link.cc has it. Stands for all headers of Gazebo.
#pragma once

#include <tinyxml2.h>

#include <Eigen/Eigen>
#include <any>
#include <chrono>
#include <functional>
#include <ignition/math/Helpers.hh>
#include <ignition/math/PID.hh>
#include <ignition/math/Pose3.hh>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <typeindex>
#include <unordered_set>
#include <vector>

#define GZ_SIM_VERSION_NAMESPACE v11
#define GZ_PI IGN_PI
#define GZ_PI_2 IGN_PI_2
#define GZ_PROFILE(name)
#define gzerr std::cerr
#define gzwarn std::clog
#define gzmsg std::clog
#define gzdbg std::clog

namespace ignition
{
namespace math
{
template <typename T, typename V> struct InMemorySession
{
};
}
}

namespace sdf
{
class Element;
typedef std::shared_ptr<Element> ElementPtr;

class Element
{
public:
  explicit Element(const tinyxml2::XMLElement *_xml) : xml(_xml) {}
  bool HasElement(const std::string &_name) const { return this->xml->FirstChildElement(_name.c_str()); }
  ElementPtr GetElement(const std::string &_name) const
  {
    return std::make_shared<Element>(this->xml->FirstChildElement(_name.c_str()));
  }
  ElementPtr Clone() const { return std::make_shared<Element>(this->xml); }
  template <typename T> T Get() const
  {
    T value{};
    Read(this->xml->GetText(), value);
    return value;
  }
  template <typename T> T Get(const std::string &_name) const { return this->Get<T>(_name, T()).first; }
  template <typename T> std::pair<T, bool> Get(const std::string &_name, const T &_default) const
  {
    return this->HasElement(_name) ? std::make_pair(this->GetElement(_name)->Get<T>(), true)
                                   : std::make_pair(_default, false);
  }
  template <typename T> bool Get(const std::string &_name, T &_value, const T &_default) const
  {
    const auto found = this->Get<T>(_name, _default);
    _value = found.first;
    return found.second;
  }

private:
  static void Read(const char *_text, std::string &_value) { _value = _text; }
  static void Read(const char *_text, bool &_value) { _value = std::string(_text) == "true" || std::string(_text) == "1"; }
  template <typename T> static void Read(const char *_text, T &_value) { std::istringstream(_text) >> _value; }
  const tinyxml2::XMLElement *xml;
};

struct JointAxis
{
  ignition::math::Vector3d xyz;
  ignition::math::Vector3d Xyz() const { return this->xyz; }
};
}

namespace gz
{
namespace math = ignition::math;

namespace msgs
{
struct Vector3d
{
  math::Vector3d value;
};
struct Double
{
  double value = 0;
  double data() const { return this->value; }
  void set_data(double _value) { this->value = _value; }
};
struct Boolean
{
  bool value = false;
  bool data() const { return this->value; }
};
inline math::Vector3d Convert(const Vector3d &_message) { return _message.value; }
}

namespace transport
{
template <typename M> std::map<std::string, std::function<void(const M &)>> &Handlers()
{
  static std::map<std::string, std::function<void(const M &)>> handlers;
  return handlers;
}
struct Node
{
  struct Publisher
  {
    template <typename M> bool Publish(const M &) { return true; }
  };
  template <typename M> Publisher Advertise(const std::string &) { return Publisher(); }
  template <typename M, typename T>
  bool Subscribe(const std::string &_topic, void (T::*_handler)(const M &), T *_self)
  {
    Handlers<M>()[_topic] = [=](const M &_message) { (_self->*_handler)(_message); };
    return true;
  }
};
struct TopicUtils
{
  static std::string AsValidTopic(const std::string &_topic) { return _topic; }
};
}

namespace sim
{
inline namespace GZ_SIM_VERSION_NAMESPACE
{
typedef std::uint64_t Entity;
const Entity kNullEntity = 0;

struct UpdateInfo
{
  std::chrono::steady_clock::duration simTime{0}, dt{0};
  bool paused = false;
};
struct EventManager
{
};

namespace components
{
template <typename T, int N> struct Component
{
  static const int typeId = N;
  T data;
  Component() : data() {}
  explicit Component(const T &_data) : data(_data) {}
  T &Data() { return this->data; }
  const T &Data() const { return this->data; }
};
struct Field
{
  typedef math::InMemorySession<double, double> Session;
  Session CreateSession() const { return Session(); }
  std::optional<Session> StepTo(const Session &, double) const { return std::nullopt; }
  std::optional<double> LookUp(const Session &, const math::Vector3d &) const { return std::nullopt; }
  std::pair<math::Vector3d, math::Vector3d> Bounds(const Session &) const { return {}; }
};
struct Frame
{
  bool Has(const std::string &) const { return false; }
  Field operator[](const std::string &) const { return Field(); }
};
struct EnvironmentalData
{
  Frame frame;
  bool staticTime = true;
};
struct BatteryPowerLoadInfo
{
  Entity battery;
  double load;
};
typedef Component<std::shared_ptr<EnvironmentalData>, 1> Environment;
typedef Component<math::Vector3d, 2> LinearVelocity;
typedef Component<math::Vector3d, 3> AngularVelocity;
typedef Component<math::Vector3d, 4> WorldLinearVelocity;
typedef Component<math::Vector3d, 5> WorldAngularVelocity;
typedef Component<math::Pose3d, 6> WorldPose;
typedef Component<math::Pose3d, 7> Pose;
typedef Component<std::vector<double>, 8> JointPosition;
typedef Component<std::vector<double>, 9> JointVelocityCmd;
typedef Component<std::string, 10> Name;
typedef Component<std::string, 11> ChildLinkName;
typedef Component<sdf::JointAxis, 12> JointAxis;
typedef Component<bool, 13> Wind;
typedef Component<bool, 14> Joint;
typedef Component<bool, 15> Link;
typedef Component<double, 16> BatterySoC;
typedef Component<BatteryPowerLoadInfo, 17> BatteryPowerLoad;
}

// Components by their kind and entity; links and joints by name; wrenches at the origins of links, world axes.
class EntityComponentManager
{
public:
  template <typename C> C *Component(Entity _entity) const
  {
    auto found = this->data.find({std::type_index(typeid(C)), _entity});
    return found == this->data.end() ? nullptr : std::any_cast<C>(&found->second);
  }
  template <typename C> void CreateComponent(Entity _entity, const C &_value)
  {
    this->data.emplace(std::make_pair(std::type_index(typeid(C)), _entity), _value);
  }
  template <typename C, typename T> void SetComponentData(Entity _entity, const T &_value)
  {
    this->data[{std::type_index(typeid(C)), _entity}] = C(_value);
  }
  template <typename C> void SetComponentData(Entity _entity, const std::initializer_list<double> &_value)
  {
    this->data[{std::type_index(typeid(C)), _entity}] = C(std::vector<double>(_value));
  }
  bool HasEntity(Entity _entity) const { return _entity != kNullEntity; }
  bool EntityHasComponentType(Entity, int) const { return true; }
  template <typename... C> Entity EntityByComponents(const C &...) const { return kNullEntity; }
  template <typename... C, typename F> void Each(const F &) const {}
  template <typename... C, typename F> void EachNew(const F &) const {}
  Entity CreateEntity() { return ++this->last; }
  void SetParentEntity(Entity, Entity) {}
  Entity ParentEntity(Entity) const { return kNullEntity; }

  std::map<std::string, Entity> links, joints;
  std::map<Entity, std::pair<math::Vector3d, math::Vector3d>> wrenches;
  std::map<Entity, Eigen::Matrix<double, 6, 6>> addedMass;
  std::string model;

private:
  mutable std::map<std::pair<std::type_index, Entity>, std::any> data;
  Entity last = 1000;
};

struct System
{
  virtual ~System() {}
};
struct ISystemConfigure
{
  virtual void Configure(const Entity &, const std::shared_ptr<const sdf::Element> &, EntityComponentManager &,
                         EventManager &) = 0;
};
struct ISystemPreUpdate
{
  virtual void PreUpdate(const UpdateInfo &, EntityComponentManager &) = 0;
};
struct ISystemPostUpdate
{
  virtual void PostUpdate(const UpdateInfo &, const EntityComponentManager &) = 0;
};
struct ISystemReset
{
  virtual void Reset(const UpdateInfo &, EntityComponentManager &) = 0;
};

inline Entity Find(const std::map<std::string, Entity> &_names, const std::string &_name)
{
  return _names.count(_name) ? _names.at(_name) : kNullEntity;
}

class Link
{
public:
  explicit Link(sim::Entity _entity) : id(_entity) {}
  std::optional<math::Vector3d> WorldAngularVelocity(const EntityComponentManager &_ecm) const
  {
    return _ecm.Component<components::WorldAngularVelocity>(this->id)->Data();
  }
  std::optional<math::Pose3d> WorldPose(const EntityComponentManager &_ecm) const
  {
    return _ecm.Component<components::WorldPose>(this->id)->Data();
  }
  std::optional<math::Pose3d> WorldInertialPose(const EntityComponentManager &_ecm) const { return this->WorldPose(_ecm); }
  std::optional<Eigen::Matrix<double, 6, 6>> WorldFluidAddedMassMatrix(const EntityComponentManager &_ecm) const
  {
    if (!_ecm.addedMass.count(this->id)) return std::nullopt;
    return _ecm.addedMass.at(this->id);
  }
  void AddWorldWrench(EntityComponentManager &_ecm, const math::Vector3d &_force, const math::Vector3d &_torque) const
  {
    _ecm.wrenches[this->id].first += _force;
    _ecm.wrenches[this->id].second += _torque;
  }
  void EnableVelocityChecks(EntityComponentManager &, bool) const {}

private:
  sim::Entity id;
};

class Model
{
public:
  explicit Model(sim::Entity _entity) : id(_entity) {}
  bool Valid(const EntityComponentManager &) const { return true; }
  sim::Entity Entity() const { return this->id; }
  std::string Name(const EntityComponentManager &_ecm) const { return _ecm.model; }
  sim::Entity LinkByName(const EntityComponentManager &_ecm, const std::string &_name) const { return Find(_ecm.links, _name); }
  sim::Entity JointByName(const EntityComponentManager &_ecm, const std::string &_name) const
  {
    return Find(_ecm.joints, _name);
  }

private:
  sim::Entity id;
};

inline std::unordered_set<Entity> entitiesFromScopedName(const std::string &_name, const EntityComponentManager &_ecm, Entity)
{
  const Entity found = _ecm.links.count(_name) ? _ecm.links.at(_name) : Find(_ecm.joints, _name);
  return found == kNullEntity ? std::unordered_set<Entity>() : std::unordered_set<Entity>{found};
}
inline math::Pose3d worldPose(Entity _entity, const EntityComponentManager &_ecm)
{
  return _ecm.Component<components::WorldPose>(_entity)->Data();
}
template <typename C> bool enableComponent(EntityComponentManager &_ecm, Entity _entity)
{
  if (!_ecm.Component<C>(_entity)) _ecm.CreateComponent(_entity, C());
  return true;
}
inline std::optional<math::Vector3d> getGridFieldCoordinates(const EntityComponentManager &, const math::Vector3d &,
                                                             const std::shared_ptr<components::EnvironmentalData> &)
{
  return std::nullopt;
}

inline std::map<std::string, std::function<System *()>> &Systems()
{
  static std::map<std::string, std::function<System *()>> systems;
  return systems;
}
}
}
}

#define GZ_ADD_PLUGIN(type, ...)                                                                                       \
  static const bool registeredSystem = gz::sim::Systems().emplace(#type, [] { return new type(); }).second;
#define GZ_ADD_PLUGIN_ALIAS(type, alias)
