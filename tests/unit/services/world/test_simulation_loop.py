import mujoco
import numba

from gslcosim_services.world.simulation_loop import call_step, find_step_address

XML = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@numba.njit
def steps(function, model, data, n):
    for _ in range(n):
        call_step(function, model, data)


def test_calling_by_address_is_calling_mj_step():
    model = mujoco.MjModel.from_xml_string(XML)
    by_address, by_name = mujoco.MjData(model), mujoco.MjData(model)
    for data in (by_address, by_name):
        data.qvel[:] = [0.1, 0.2, 3.0, 1.0, -2.0, 0.5]
    steps(find_step_address(), model._address, by_address._address, 50)
    for _ in range(50):
        mujoco.mj_step(model, by_name)
    assert by_address.qpos.tolist() == by_name.qpos.tolist()
    assert by_address.qvel.tolist() == by_name.qvel.tolist()
