from studies import kinematics

kinematics.STUDY.run(kinematics.__doc__)
