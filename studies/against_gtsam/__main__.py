from studies import against_gtsam

against_gtsam.STUDY.run(against_gtsam.__doc__)
