from studies import camera_covariance

camera_covariance.STUDY.run(camera_covariance.__doc__)
