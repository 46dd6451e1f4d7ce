from studies import maintenance

maintenance.STUDY.run(maintenance.__doc__)
