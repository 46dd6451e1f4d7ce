from studies import laser_camera

laser_camera.STUDY.run(laser_camera.__doc__)
