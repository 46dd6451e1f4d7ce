from studies import robot_accuracy

robot_accuracy.STUDY.run(robot_accuracy.__doc__)
