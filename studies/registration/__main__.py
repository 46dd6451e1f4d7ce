from studies import registration

registration.STUDY.run(registration.__doc__)
