from studies import kinhec

kinhec.STUDY.run(kinhec.__doc__)
