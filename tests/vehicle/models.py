"""Model files in the form of the simulators that people use, with the numbers those publish.

Shapes, sensors and other plugins are left out, as they say nothing of the vehicle's motion.
"""

from __future__ import annotations

IRIS_HUBS = ((0.13, -0.22), (-0.13, 0.2), (0.13, 0.22), (-0.13, -0.2))
X500_HUBS = ((0.174, -0.174), (-0.174, 0.174), (0.174, 0.174), (-0.174, -0.174))
SPINS = ("ccw", "ccw", "cw", "cw")


def _inertial(mass: float, ixx: float, iyy: float, izz: float) -> str:
    return (
        f"<inertial><mass>{mass}</mass><inertia><ixx>{ixx}</ixx><ixy>0</ixy><ixz>0</ixz>"
        f"<iyy>{iyy}</iyy><iyz>0</iyz><izz>{izz}</izz></inertia></inertial>"
    )


def _motor(i: int, filename: str, **numbers: float) -> str:
    cells = "".join(f"<{key}>{value}</{key}>" for key, value in numbers.items())
    return (
        f"<plugin name='motor_{i}' filename='{filename}'><jointName>rotor_{i}_joint</jointName>"
        f"<linkName>rotor_{i}</linkName><turningDirection>{SPINS[i]}</turningDirection>"
        f"<motorNumber>{i}</motorNumber>{cells}</plugin>"
    )


def iris() -> str:
    """PX4's iris of Gazebo classic (iris.sdf.jinja): rotors placed by their joints."""
    parts = [
        f"<link name='base_link'>{_inertial(1.5, 0.029125, 0.029125, 0.055225)}</link>",
        "<joint name='/imu_joint' type='revolute'><pose relative_to='base_link'>0 0 0 0 0 0</pose>"
        "<parent>base_link</parent><child>/imu_link</child></joint>",
        "<link name='/imu_link'><pose relative_to='/imu_joint'>0 0 0 0 0 0</pose>"
        f"{_inertial(0.015, 1e-05, 1e-05, 1e-05)}</link>",
        "<model name='gps0'><link name='link'><pose>0 0 0 0 -0 0</pose>"
        f"{_inertial(0.01, 2.1733e-06, 2.1733e-06, 1.8e-07)}</link></model>",
        "<joint name='gps0_joint' type='fixed'><parent>base_link</parent>"
        "<child>gps0::link</child></joint>",
        "<plugin name='mavlink_interface' filename='libgazebo_mavlink_interface.so'>"
        "<control_channels><channel name='rotor1'><input_index>0</input_index>"
        "<input_offset>0</input_offset><input_scaling>1000</input_scaling>"
        "<zero_position_disarmed>0</zero_position_disarmed>"
        "<zero_position_armed>100</zero_position_armed></channel></control_channels></plugin>",
    ]
    for i, (x, y) in enumerate(IRIS_HUBS):
        parts += [
            f"<joint name='rotor_{i}_joint' type='revolute'>"
            f"<pose relative_to='base_link'>{x} {y} 0.023 0 -0 0</pose>"
            f"<parent>base_link</parent><child>rotor_{i}</child></joint>",
            f"<link name='rotor_{i}'><pose relative_to='rotor_{i}_joint'>0 0 0 0 -0 0</pose>"
            f"{_inertial(0.005, 9.75e-07, 0.000273104, 0.000274004)}<collision name='c'><geometry>"
            "<cylinder><length>0.005</length><radius>0.128</radius></cylinder></geometry>"
            "</collision></link>",
            _motor(
                i,
                "libgazebo_motor_model.so",
                timeConstantUp=0.0125,
                timeConstantDown=0.025,
                maxRotVelocity=1100,
                motorConstant=5.84e-06,
                momentConstant=0.06,
                rotorDragCoefficient=0.000175,
                rollingMomentCoefficient=1e-06,
            ),
        ]
    return f"<sdf version='1.7'><model name='iris'>{''.join(parts)}</model></sdf>"


def x500_base() -> str:
    """PX4's x500_base of Gazebo: rotors placed by their links."""
    parts = [f"<link name='base_link'>{_inertial(2.0, 0.0216666667, 0.0216666667, 0.04)}</link>"]
    for i, (x, y) in enumerate(X500_HUBS):
        parts += [
            f"<link name='rotor_{i}'><pose>{x} {y} 0.06 0 0 0</pose>"
            f"{_inertial(0.0160769231, 3.84649105e-07, 2.61158517e-05, 2.64985823e-05)}"
            "<collision name='c'><geometry><box><size>0.2792307692 0.0169230769 0.0008461538</size>"
            "</box></geometry></collision></link>",
            f"<joint name='rotor_{i}_joint' type='revolute'><parent>base_link</parent>"
            f"<child>rotor_{i}</child><axis><xyz>0 0 1</xyz></axis></joint>",
        ]
    return (
        "<?xml version='1.0' encoding='UTF-8'?><sdf version='1.9'><model name='x500_base'>"
        f"<pose>0 0 .24 0 0 0</pose>{''.join(parts)}</model></sdf>"
    )


def x500() -> str:
    """PX4's x500 of Gazebo: the motors, and the rest by inclusion."""
    motors = "".join(
        _motor(
            i,
            "gz-sim-multicopter-motor-model-system",
            timeConstantUp=0.0125,
            timeConstantDown=0.025,
            maxRotVelocity=1000.0,
            motorConstant=8.54858e-06,
            momentConstant=0.016,
            rotorDragCoefficient=8.06428e-05,
            rollingMomentCoefficient=1e-06,
        )
        for i in range(4)
    )
    return (
        "<?xml version='1.0' encoding='UTF-8'?><sdf version='1.9'><model name='x500'>"
        f"<include merge='true'><uri>model://x500_base</uri></include>{motors}</model></sdf>"
    )


def cf2x() -> str:
    """The Crazyflie 2 X of gym-pybullet-drones (cf2x.urdf)."""
    corners = ((0.028, 0.028), (-0.028, 0.028), (-0.028, -0.028), (0.028, -0.028))
    props = "".join(
        f"<link name='prop{i}_link'><inertial><origin rpy='0 0 0' xyz='{x} {y} 0'/>"
        "<mass value='0'/><inertia ixx='0' ixy='0' ixz='0' iyy='0' iyz='0' izz='0'/></inertial>"
        f"</link><joint name='prop{i}_joint' type='fixed'><parent link='base_link'/>"
        f"<child link='prop{i}_link'/></joint>"
        for i, (x, y) in enumerate(corners)
    )
    return (
        "<?xml version='1.0' ?><robot name='cf2'><properties arm='0.0397' kf='3.16e-10'"
        " km='7.94e-12' thrust2weight='2.25' max_speed_kmh='30' gnd_eff_coeff='11.36859'"
        " prop_radius='2.31348e-2' drag_coeff_xy='9.1785e-7' drag_coeff_z='10.311e-7'"
        " dw_coeff_1='2267.18' dw_coeff_2='.16' dw_coeff_3='-.11' /><link name='base_link'>"
        "<inertial><origin rpy='0 0 0' xyz='0 0 0'/><mass value='0.027'/><inertia ixx='1.4e-5'"
        " ixy='0.0' ixz='0.0' iyy='1.4e-5' iyz='0.0' izz='2.17e-5'/></inertial></link>"
        f"{props}</robot>"
    )


HUMMINGBIRD = '''"""Physical parameters for the AscTec Hummingbird."""
import numpy as np

d = 0.17 # Arm length

quad_params = {
    'mass': 0.500,       # kg
    'Ixx':  3.65e-3,
    'Iyy':  3.68e-3,
    'Izz':  7.03e-3,
    'Ixy':  0.0,
    'Iyz':  0.0,
    'Ixz':  0.0,
    'num_rotors': 4,
    'rotor_radius': 0.10,
    'rotor_pos': {
                    'r1': d*np.array([ 0.70710678118, 0.70710678118, 0]),
                    'r2': d*np.array([ 0.70710678118,-0.70710678118, 0]),
                    'r3': d*np.array([-0.70710678118,-0.70710678118, 0]),
                    'r4': d*np.array([-0.70710678118, 0.70710678118, 0]),
                 },
    'rotor_directions': np.array([1,-1,1,-1]),
    'rI': np.array([0,0,0]),
    'c_Dx': 0.5e-2,
    'c_Dy': 0.5e-2,
    'c_Dz': 1e-2,
    'k_eta': 5.57e-06,
    'k_m':   1.36e-07,
    'k_d':   1.19e-04,
    'k_z':   2.32e-04,
    'k_h':   3.39e-3,
    'k_flap': 0.0,
    'tau_m': 0.005,
    'rotor_speed_min': 0,
    'rotor_speed_max': 1500,
    'motor_noise_std': 0.0,
}
'''

SIH = """#!/bin/sh
# 10040 SIH quadrotor X
. ${R}etc/init.d/rc.mc_defaults
param set-default SIH_VEHICLE_TYPE 0
param set-default SIH_MASS 1.2
param set-default SIH_T_MAX 6.0
SIH_L_ROLL=0.18
1\t1\tSIH_KDV\t0.5\t9
"""
