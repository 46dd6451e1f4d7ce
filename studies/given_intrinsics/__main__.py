from studies import given_intrinsics

given_intrinsics.STUDY.run(given_intrinsics.__doc__)
