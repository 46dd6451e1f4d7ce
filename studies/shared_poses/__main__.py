from studies import shared_poses

shared_poses.STUDY.run(shared_poses.__doc__)
