// Runs an exported scenario freely in Stonefish, without graphics, and prints the motion of its robot.
//
//     driver FOLDER PLAN            FOLDER holds vehicle.scn and part.obj
//
// PLAN:  step [s]  samples  steps between two samples
//        u v w p q r phi theta at the start, of the body's origin through the water; m/s, rad/s and rad, forward, starboard, down
//        the water's velocity north, east and down, m/s; the heading at the start is north
//        number of actuators and their names
//        for each step the setpoints of the actuators
// Output: a line "mass ADDED I_x I_y I_z" of the added mass and inertia, then a line "state u v w p q r phi theta" for each sample.

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <string>
#include <vector>

#include <actuators/Rudder.h>
#include <actuators/Thruster.h>
#include <core/ConsoleSimulationApp.h>
#include <core/FeatherstoneRobot.h>
#include <core/ScenarioParser.h>
#include <core/SimulationManager.h>
#include <entities/FeatherstoneEntity.h>
#include <entities/SolidEntity.h>
#include <entities/forcefields/Ocean.h>
#include <entities/forcefields/Uniform.h>

namespace {

[[noreturn]] void fail(const std::string& words)
{
    std::cerr << words << std::endl;
    std::exit(1);
}

struct Plan
{
    double step = 0.0;
    int samples = 0;
    int every = 0;
    std::vector<double> start;
    std::vector<double> current;
    std::vector<std::string> names;
    std::vector<std::vector<double>> setpoints;
};

Plan readPlan(const std::string& path)
{
    std::ifstream file(path);
    Plan plan;
    size_t count = 0;
    file >> plan.step >> plan.samples >> plan.every;
    plan.start.resize(8);
    for (double& value : plan.start) file >> value;
    plan.current.resize(3);
    for (double& value : plan.current) file >> value;
    file >> count;
    plan.names.resize(count);
    for (std::string& name : plan.names) file >> name;
    plan.setpoints.assign(static_cast<size_t>(plan.samples - 1) * plan.every, std::vector<double>(count));
    for (auto& row : plan.setpoints)
        for (double& value : row) file >> value;
    if (!file) fail(path + ": too short");
    return plan;
}

class Manager : public sf::SimulationManager
{
public:
    Manager(const std::string& scenario, double step) : SimulationManager(sf::Scalar(1.0 / step)), scenario_(scenario) {}

    void BuildScenario() override
    {
        sf::ScenarioParser parser(this);
        const bool parsed = parser.Parse(scenario_);
        for (const sf::ConsoleMessage& line : parser.getLog()) std::cerr << line.text << "\n";
        if (!parsed) fail(scenario_ + ": not parsed");
    }

private:
    std::string scenario_;
};

class App : public sf::ConsoleSimulationApp
{
public:
    App(const std::string& folder, Manager* manager, const Plan& plan)
        : ConsoleSimulationApp("driver", folder, manager), manager_(manager), plan_(plan)
    {
        setMaxPhysicsThreads(1);
    }

protected:
    void LoopInternal() override
    {
        auto* robot = dynamic_cast<sf::FeatherstoneRobot*>(manager_->getRobot(0u));
        if (robot == nullptr) fail("no robot in the scenario");
        body_ = robot->getDynamics()->getLink(0).solid;
        findActuators(robot);
        water_ = sf::Vector3(plan_.current[0], plan_.current[1], plan_.current[2]);
        manager_->getOcean()->AddVelocityField(new sf::Uniform(water_));
        if (!water_.isZero()) manager_->getOcean()->EnableCurrents();
        place(robot->getDynamics()->getMultiBody());
        const sf::Vector3 inertia = body_->getAddedInertia();
        std::cout << std::setprecision(17) << "mass " << body_->getAugmentedMass() - body_->getMass() << " " << inertia.x() << " "
                  << inertia.y() << " " << inertia.z() << "\n";
        settleActuators();
        print();
        for (size_t k = 0; k < plan_.setpoints.size(); ++k)
        {
            command(plan_.setpoints[k]);
            manager_->StepSimulation(plan_.step);
            if ((k + 1) % plan_.every == 0) print();
        }
        Quit();
    }

private:
    void findActuators(sf::Robot* robot)
    {
        for (const std::string& name : plan_.names)
        {
            sf::Actuator* found = robot->getActuator(robot->getName() + "/" + name);
            if (found == nullptr) fail("no actuator " + name);
            actuators_.push_back(found);
        }
    }

    void command(const std::vector<double>& setpoints)
    {
        for (size_t i = 0; i < actuators_.size(); ++i)
        {
            if (auto* thruster = dynamic_cast<sf::Thruster*>(actuators_[i])) thruster->setSetpoint(setpoints[i]);
            else if (auto* rudder = dynamic_cast<sf::Rudder*>(actuators_[i])) rudder->setSetpoint(setpoints[i]);
            else fail("an actuator of a kind that is not exported: " + plan_.names[i]);
        }
    }

    // Rotors begin at rest in the first setpoint: their lag runs out before the clock starts. Each step clears forces first.
    void settleActuators()
    {
        if (plan_.setpoints.empty()) return;
        command(plan_.setpoints.front());
        for (int i = 0; i < 20000; ++i)
            for (sf::Actuator* actuator : actuators_) actuator->Update(plan_.step);
    }

    // Puts the body at 100 m depth with the velocity and attitude of the start.
    void place(btMultiBody* multibody)
    {
        const std::vector<double>& s = plan_.start;
        const sf::Transform origin(sf::Quaternion(0.0, s[7], s[6]), sf::Vector3(0.0, 0.0, 100.0));
        const sf::Transform centre = origin * body_->getCG2OTransform().inverse();
        const sf::Matrix3 turned = origin.getBasis();
        const sf::Vector3 spin = turned * sf::Vector3(s[3], s[4], s[5]);
        const sf::Vector3 speed = turned * sf::Vector3(s[0], s[1], s[2]) + water_;
        multibody->setBaseWorldTransform(centre);
        multibody->setBaseOmega(spin);
        multibody->setBaseVel(speed + spin.cross(centre.getOrigin() - origin.getOrigin()));
        btAlignedObjectArray<sf::Quaternion> rotations;
        btAlignedObjectArray<sf::Vector3> places;
        multibody->forwardKinematics(rotations, places);
        multibody->updateCollisionObjectWorldTransforms(rotations, places);
    }

    void print() const
    {
        const sf::Transform origin = body_->getOTransform();
        const sf::Matrix3 back = origin.getBasis().transpose();
        const sf::Vector3 spin = body_->getAngularVelocity();
        const sf::Vector3 arm = origin.getOrigin() - body_->getCGTransform().getOrigin();
        const sf::Vector3 speed = back * (body_->getLinearVelocity() + spin.cross(arm) - water_);
        const sf::Vector3 local = back * spin;
        const sf::Matrix3& turned = origin.getBasis();
        std::cout << "state " << speed.x() << " " << speed.y() << " " << speed.z() << " " << local.x() << " " << local.y() << " "
                  << local.z() << " " << std::atan2(turned[2][1], turned[2][2]) << " " << -std::asin(turned[2][0]) << "\n";
    }

    Manager* manager_;
    const Plan& plan_;
    sf::SolidEntity* body_ = nullptr;
    sf::Vector3 water_;
    std::vector<sf::Actuator*> actuators_;
};

}  // namespace

int main(int argc, char** argv)
{
    if (argc != 3) fail("usage: driver FOLDER PLAN");
    const std::string folder = std::string(argv[1]) + "/";
    const Plan plan = readPlan(argv[2]);
    Manager manager(folder + "vehicle.scn", plan.step);
    App app(folder, &manager, plan);
    app.Run(true, false, plan.step);
    std::cout.flush();
    std::_Exit(0);  // its own clean-up is for graphics
}
